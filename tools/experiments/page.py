"""The page of the experiments: sections in a fixed order, each replaced by itself, each with its own commit."""

import os
import re

from models import WALKTHRU
from session import judged

ORDER = ["grouping", "partition", "granularity", "scheduling", "speedup", "five-floors", "memory"]

HEAD = """\
# Experiments

The experiments of the paper (T. Funkhouser, SIGGRAPH 1996, section 6), and one of ours. Written by
`tools/experiments/experiments.py`: nothing in here is typed, and each section is of the commit that it names. The
paper's curves have no numbers in its text; where it gives none, its column says what it found in words.

Transfer is the power that is absorbed or has left the model, as a share of what lamps emit: light that is still under
way is what lacks to 100 %. It is summed over the last visit to each group, and over red, green and blue. A visit is the
solving of one group in one iteration.
"""

# Word for word from the models' own notice, which asks for it.
ACKNOWLEDGEMENT = f"""\
## Acknowledgement

Results marked so are of the "{WALKTHRU}", version 1.0, December 1994, Copyright (c) 1994 Celeste Fowler, Tom
Funkhouser, Seth Teller, and Carlo Sequin. Its geometry is no part of this project. From its notice:

> Acknowledgements: This data has been generated from the work of
> many individuals, all members of the UC Berkeley Walkthrough Group:
>
> Thurman Brown, Rick Bukowski, Laura Downs, Tom Funkhouser,
> Delnaz Khorramabadi, Carlo Sequin, MaryAnn Simmons, and Seth Teller,
>
> as well as members of the Princeton Computer Graphics Laboratory:
>
> Celeste Fowler and Pat Hanrahan.
"""

MARK = re.compile(r"<!-- begin (\S+) -->\n(.*?)<!-- end \1 -->\n", re.DOTALL)


def sections(text):
    """Sections of a page, by name."""
    return dict(MARK.findall(text))


def put(text, name, section):
    """The page with one section replaced, written whole."""
    known = {**sections(text), name: section}
    parts = [HEAD]
    parts += [f"<!-- begin {of} -->\n{known[of]}<!-- end {of} -->\n" for of in ORDER if of in known]
    if any(WALKTHRU in known[of] for of in ORDER if of in known):
        parts.append(ACKNOWLEDGEMENT)
    return "\n".join(parts)


def section(title, prose, tables, pictures, facts):
    """A section. `tables`: (heads, rows); `pictures`: (what is seen, file); `facts`: what was run, where and when."""
    parts = [f"## {title}", *prose]
    parts += [judged.table(heads, rows) for heads, rows in tables]
    parts += [f"![{what}]({file})" for what, file in pictures]
    parts.append("\n".join(f"- {name}: {value}" for name, value in facts["lines"]))
    parts.append("```sh\n" + "\n".join(facts["commands"]) + "\n```")
    return "\n\n".join(parts) + "\n"


def write(path, name, text):
    """Puts a section into a page."""
    before = ""
    if os.path.exists(path):
        with open(path) as file:
            before = file.read()
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    new = path + ".new"
    with open(new, "w") as file:
        file.write(put(before, name, text))
    os.replace(new, path)

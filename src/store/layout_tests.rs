//! `schema/SEGMENTS.md` gives the fields of every record, type by type, as `src/model/` defines them.

/// What the page calls each record, in its order, and where it is defined.
const RECORDS: [(&str, &str, &str); 21] = [
    ("Head", GEOMETRY, "ClusterHead"),
    ("Patch", GEOMETRY, "PatchRecord"),
    ("Seam", GEOMETRY, "Seam"),
    ("Side", GEOMETRY, "SideMaterial"),
    ("Head", VISIBILITY, "VisibilityHead"),
    ("Cluster", VISIBILITY, "VisibleCluster"),
    ("Head", LIGHT, "LightHead"),
    ("Row", LIGHT, "RowLight"),
    ("Element", LIGHT, "ElementLight"),
    ("Head", LINKS, "LinksHead"),
    ("Row", LINKS, "RowHead"),
    ("Share", LINKS, "StoredShare"),
    ("Hit", LINKS, "StoredHit"),
    ("Node", RAYS, "RayNode"),
    ("Face", RAYS, "RayPatch"),
    ("Cut", RAYS, "FaceCut"),
    ("Cut node", include_str!("../model/cut.rs"), "CutNode"),
    ("Cluster reference", RAYS, "ClusterRef"),
    ("Corner", ORIGIN, "BakeCorner"),
    ("Source", ORIGIN, "PatchSource"),
    ("Extent", include_str!("extent_header.rs"), "ExtentHeader"),
];
const GEOMETRY: &str = include_str!("../model/geometry.rs");
const VISIBILITY: &str = include_str!("../model/visibility.rs");
const LIGHT: &str = include_str!("../model/light.rs");
const LINKS: &str = include_str!("../model/links.rs");
const RAYS: &str = include_str!("../model/rays.rs");
const ORIGIN: &str = include_str!("../model/origin.rs");

/// Types of a struct's fields as the page writes them: `f32[3][4]`.
fn defined(source: &str, name: &str) -> Vec<String> {
    let start = source.find(&format!("pub struct {name} {{")).unwrap_or_else(|| panic!("no {name}"));
    let body = &source[start..start + source[start..].find("\n}").expect("a struct ends")];
    body.lines()
        .filter_map(|line| line.trim().strip_prefix("pub ")?.strip_suffix(',')?.split_once(": "))
        .map(|f| as_on_page(f.1))
        .collect()
}

fn as_on_page(of: &str) -> String {
    match of.strip_prefix('[').and_then(|inner| inner.strip_suffix(']')?.rsplit_once("; ")) {
        Some((inner, count)) => format!("{}[{count}]", as_on_page(inner)),
        None => of.to_owned(),
    }
}

fn bytes_of(of: &str) -> usize {
    let (scalar, counts) = of.split_once('[').unwrap_or((of, ""));
    let counts = counts.split(['[', ']']).filter_map(|n| n.parse::<usize>().ok()).product::<usize>();
    scalar[1..].parse::<usize>().expect("a scalar") / 8 * counts
}

/// Types in backticks.
fn on_page(sentence: &str) -> Vec<String> {
    let is_type = |word: &&str| {
        let scalar = word.split('[').next().unwrap_or_default();
        ["u8", "u16", "u32", "u64", "f32", "f64"].contains(&scalar)
    };
    sentence.split('`').skip(1).step_by(2).filter(is_type).map(str::to_owned).collect()
}

#[test]
fn records_have_the_fields_that_the_format_page_states() {
    let page = include_str!("../../schema/SEGMENTS.md");
    let mut rest = page;
    for (name, source, record) in &RECORDS[..RECORDS.len() - 1] {
        let own = defined(source, record);
        let bytes: usize = own.iter().map(|of| bytes_of(of)).sum();
        let heading = format!("{name}, {bytes} bytes");
        let Some(at) = rest.find(&heading) else { panic!("the page does not say `{heading}` next") };
        rest = &rest[at + heading.len()..];
        let end = rest.find(". ").into_iter().chain(rest.find(".\n")).min().unwrap_or(rest.len());
        assert_eq!(on_page(&rest[..end]), own, "{record}");
    }
    let [.., (_, source, header)] = &RECORDS;
    assert_eq!(defined(source, header).iter().map(|of| bytes_of(of)).sum::<usize>(), 64);
}

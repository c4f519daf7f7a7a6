//! `run` hands every flag of the stages that it starts on to them.

use std::ffi::OsString;
use std::path::PathBuf;

use super::args::{Common, RunArgs};
use super::dispatch::{cores, solve_options};
use super::settings::{self, Resolved, Setting};
use crate::base::text::for_shell;
use crate::base::{Error, Result};
use crate::stages::{run, solve_group};

/// The options of a run.
pub fn options(args: &RunArgs, common: &Common, resolved: &Resolved) -> Result<run::Options> {
    let store = match (&args.store, args.models.first()) {
        (Some(store), _) => store.clone(),
        (None, Some(model)) => settings::default_store(model),
        (None, None) => PathBuf::new(),
    };
    if args.writing.fresh && args.models.is_empty() {
        return Err(Error::Usage {
            message: "`--fresh` empties the store, and no model is given to fill it".to_owned(),
            help: format!("name the models: `clerestory run MODEL.obj --store {} --fresh`", for_shell(&store)),
        });
    }
    let own = resolved.settings("run");
    let command = |verb: &str| {
        let mut line: Vec<OsString> = vec![verb.into(), store.clone().into()];
        line.extend(handed_on(&own, verb));
        line
    };
    let ingest = (!args.models.is_empty()).then(|| {
        let mut line = command("ingest");
        if let Some(materials) = &args.ingest.materials {
            line.extend(["--materials".into(), materials.clone().into()]);
        }
        line.extend(args.models.iter().map(|m| m.clone().into()));
        if args.writing.fresh {
            line.push("--fresh".into());
        }
        line
    });
    let mut worker = command("solve-group");
    worker.push("--until-done".into());
    if let Some(version) = args.version {
        worker.extend(["--version".into(), version.to_string().into()]);
    }
    Ok(run::Options {
        program: std::env::current_exe().map_err(|e| Error::failed(format!("this program: {e}"), "try again"))?,
        ingest,
        visibility: command("visibility"),
        partition: command("partition"),
        worker,
        audit: (command("audit"), args.audit),
        solve: solve_options(
            solve_group::Which::UntilDone,
            &args.solve,
            &args.schedule,
            (args.seed.seed, args.version, common.memory),
        ),
        workers: args.workers.workers.map_or_else(cores, |n| n as usize),
        max_iterations: args.max_iterations,
        keep: args.keep,
        wait: common.wait,
        store,
    })
}

/// The values of `run` that a verb has a flag for, as that flag.
fn handed_on(own: &[Setting], verb: &str) -> Vec<OsString> {
    let flags = settings::flags_of(verb);
    let mut out: Vec<OsString> = Vec::new();
    for setting in own {
        let flag = match (verb, setting.flag.as_str()) {
            ("partition", "partition") => "method",
            ("audit", "audit") => "places",
            // On `run` the first is visibility's; a path is bytes, which a value is not.
            ("partition", "method") | (_, "progress" | "materials") => continue,
            (_, flag) => flag,
        };
        if flags.iter().any(|f| f == flag) {
            out.push(format!("--{flag}={}", setting.value).into());
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_reach_the_stages_that_have_them() {
        let line = [
            "clerestory",
            "run",
            "a.obj",
            "--partition",
            "split",
            "--units",
            "cm",
            "--missing",
            "0.01",
            "--inner",
            "2",
            "--memory",
            "1G",
        ];
        let line: Vec<OsString> = line.iter().map(OsString::from).collect();
        let resolved = settings::resolve(&line).unwrap().unwrap();
        let own = resolved.settings("run");
        let words = |verb: &str| -> Vec<String> {
            handed_on(&own, verb).iter().map(|w| w.to_string_lossy().into_owned()).collect()
        };
        for (verb, flag) in [
            ("ingest", "--units=cm"),
            ("visibility", "--missing=0.01"),
            ("visibility", "--method=sampled"),
            ("partition", "--method=split"),
            ("solve-group", "--inner=2"),
            ("solve-group", "--memory=1G"),
            ("audit", "--places=256"),
            ("audit", "--seed=1"),
        ] {
            assert!(words(verb).iter().any(|w| w == flag), "{verb} {flag}: {:?}", words(verb));
        }
        assert_eq!(words("partition").iter().filter(|w| w.starts_with("--method")).count(), 1);
        for verb in settings::STAGES {
            let mut child: Vec<OsString> = vec!["clerestory".into(), verb.into(), "a.clr".into()];
            child.extend(handed_on(&own, verb));
            child.extend(match verb {
                "ingest" => vec!["a.obj".into()],
                "solve-group" => vec!["--until-done".into()],
                _ => vec![],
            });
            settings::resolve(&child).unwrap().unwrap();
        }
    }
}

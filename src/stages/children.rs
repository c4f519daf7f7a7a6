//! Stage commands as child processes: started, listened to, ended.

use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, Read};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde::Deserialize;
use serde_json::Value;

use crate::base::text::shown;
use crate::base::{Error, Progress, Result};
use crate::model::figures::ProcessFigures;

/// How often children are looked at that take their time.
pub const LOOK: Duration = Duration::from_millis(20);

/// How soon they are looked at first: tasks of small models take some milliseconds.
pub const FIRST_LOOK: Duration = Duration::from_millis(1);

/// How long an interrupted child may take to stop by itself.
const GRACE: Duration = Duration::from_secs(5);

/// Last lines of a child's stderr kept to say why it died.
const LAST_LINES: usize = 8;

/// How a child ended.
#[derive(Debug)]
pub enum Ended {
    /// With exit code 0.
    Done,
    /// With an error of its own.
    Failed(Error),
    /// By a signal or a panic.
    Died(String),
}

/// An error as `--json` prints it.
#[derive(Deserialize)]
struct ExitError {
    code: u8,
    message: String,
    help: String,
}

impl ExitError {
    fn into_error(self) -> Error {
        let Self { code, message, help } = self;
        match code {
            2 => Error::Usage { message, help },
            3 => Error::NotConverged { message, help },
            11 => {
                let (store, holder) = message.split_once(": busy, held by ").unwrap_or(("", &message));
                Error::Busy { store: PathBuf::from(store), holder: holder.to_owned() }
            }
            12 => {
                let (path, detail) = message.split_once(": damaged: ").unwrap_or(("", &message));
                Error::damaged(Path::new(path), detail)
            }
            13 => Error::StageMissing { message, help },
            14 => Error::TooLarge { message, help },
            130 => Error::Interrupted,
            _ => Error::failed(message, help),
        }
    }
}

/// What a child wrote to stderr: its error, and its last lines.
type Complaints = (Option<ExitError>, Vec<String>);

/// A running child. Dropped, it is killed.
pub struct Running {
    child: Child,
    document: Option<JoinHandle<Value>>,
    complaints: Option<JoinHandle<Complaints>>,
}

impl Running {
    /// Starts `program ARGS --json --progress none` in our process group.
    pub fn start(program: &Path, args: &[OsString]) -> Result<Self> {
        let mut child = Command::new(program)
            .args(args)
            .args(["--json", "--progress", "none"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| Error::io(program, &e))?;
        let document = child.stdout.take().map(|mut out| {
            std::thread::spawn(move || {
                let mut text = String::new();
                // What cannot be read is as good as not written: the exit code decides.
                let _ = out.read_to_string(&mut text);
                serde_json::from_str(&text).unwrap_or(Value::Null)
            })
        });
        let complaints = child.stderr.take().map(|err| std::thread::spawn(move || listen(BufReader::new(err))));
        Ok(Self { child, document, complaints })
    }

    /// How it ended, if it has; adds what it used and passes its warnings on.
    pub fn ended(&mut self, used: &mut ProcessFigures, progress: &dyn Progress) -> Result<Option<Ended>> {
        let status = self.child.try_wait().map_err(|e| Error::failed(format!("a child process: {e}"), "run again"))?;
        let Some(status) = status else { return Ok(None) };
        let document = self.document.take().and_then(|h| h.join().ok()).unwrap_or(Value::Null);
        let (error, lines) = self.complaints.take().and_then(|h| h.join().ok()).unwrap_or_default();
        // A child that died says nothing.
        used.add(&ProcessFigures::deserialize(&document).unwrap_or_default());
        for warning in document.get("warnings").and_then(Value::as_array).into_iter().flatten() {
            progress.warn(warning.as_str().unwrap_or_default());
        }
        Ok(Some(verdict(status, error, &lines)))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already: then there is nothing to kill.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn listen(lines: impl BufRead) -> Complaints {
    let (mut error, mut last) = (None, Vec::new());
    // To the end whatever it holds: a child that nobody listens to stands still.
    for line in lines.split(b'\n').map_while(std::io::Result::ok) {
        let line = shown(OsStr::from_bytes(&line));
        match serde_json::from_str::<ExitError>(&line) {
            Ok(found) => error = Some(found),
            Err(_) => {
                if last.len() == LAST_LINES {
                    last.remove(0);
                }
                last.push(line);
            }
        }
    }
    (error, last)
}

fn verdict(status: ExitStatus, error: Option<ExitError>, lines: &[String]) -> Ended {
    match (status.code(), error) {
        (Some(0), _) => Ended::Done,
        (Some(_), Some(error)) => Ended::Failed(error.into_error()),
        // Exit codes of ours without an error document: the command line was not understood.
        (Some(2), None) => Ended::Failed(Error::failed(lines.join(" / "), "run the stage by itself to see why")),
        (Some(130), None) => Ended::Failed(Error::Interrupted),
        _ => {
            let said = lines.last().map(|line| format!(": {line}")).unwrap_or_default();
            Ended::Died(format!("{status}{said}"))
        }
    }
}

/// Lets interrupted children stop by themselves (a terminal interrupts the whole process group),
/// then ends those that have not.
pub fn stop(mut children: Vec<Running>, used: &mut ProcessFigures, progress: &dyn Progress) -> Result<()> {
    let end = Instant::now() + GRACE;
    while !children.is_empty() && Instant::now() < end {
        let mut left = Vec::new();
        for mut child in children {
            if child.ended(used, progress)?.is_none() {
                left.push(child);
            }
        }
        children = left;
        std::thread::sleep(LOOK);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Quiet;

    fn run(script: &str) -> (Ended, ProcessFigures) {
        let mut used = ProcessFigures::default();
        let args = ["-c", script, "sh"].map(OsString::from);
        let mut child = Running::start(Path::new("/bin/sh"), &args).unwrap();
        loop {
            if let Some(ended) = child.ended(&mut used, &Quiet).unwrap() {
                return (ended, used);
            }
            std::thread::sleep(LOOK);
        }
    }

    #[test]
    fn a_child_s_figures_errors_and_deaths_are_told_apart() {
        let (ended, used) = run(r#"echo '{"peak_anon_bytes": 7, "cpu_s": 0.5}'"#);
        assert!(matches!(ended, Ended::Done) && used.used.peak_anon_bytes == 7 && used.used.cpu_s == 0.5);
        let (ended, _) =
            run(r#"echo '{"message_type":"exit_error","code":14,"message":"too large","help":"less"}' >&2; exit 14"#);
        assert!(matches!(ended, Ended::Failed(Error::TooLarge { .. })), "{ended:?}");
        let (ended, _) = run(r#"echo '{"code":11,"message":"a.clr: busy, held by pid 7","help":""}' >&2; exit 11"#);
        let Ended::Failed(error) = ended else { panic!("{ended:?}") };
        assert_eq!(error.to_string(), "a.clr: busy, held by pid 7");
        let (ended, _) = run("echo oh no >&2; kill -9 $$");
        assert!(matches!(&ended, Ended::Died(how) if how.contains("oh no")), "{ended:?}");
    }
}

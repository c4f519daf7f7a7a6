//! What every verb returns: its keys of the JSON document, and what people read.

use crate::base::Error;

/// Serialised it gives the verb's own keys; the command line adds those that all verbs have. `next` among them is the
/// command to type next.
pub trait Summary: serde::Serialize {
    /// A few lines for people, without the resource figures and the next command.
    fn lines(&self) -> Vec<String>;

    /// Why the exit code is not 0 although the work was done, if so.
    fn shortfall(&self) -> Option<Error> {
        None
    }
}

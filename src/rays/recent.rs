//! What was asked of nodes lately, by name, in bounded memory: a newer answer takes the place of an older.

use std::cell::RefCell;

use crate::base::NodeName;
use crate::geom::sequence::mix;

/// Up to `ROOM` answers by name. The escape, which is never asked for, marks what is empty.
pub struct Recent<T, const ROOM: usize>(RefCell<Vec<(NodeName, T)>>);

impl<T: Copy + Default, const ROOM: usize> Default for Recent<T, ROOM> {
    fn default() -> Self {
        Self(RefCell::new(vec![(NodeName::ESCAPE, T::default()); ROOM]))
    }
}

impl<T: Copy + Default, const ROOM: usize> Recent<T, ROOM> {
    fn slot(name: NodeName) -> usize {
        mix(name.0) as usize % ROOM
    }

    /// The answer for a node, if it is still known.
    #[must_use]
    pub fn get(&self, name: NodeName) -> Option<T> {
        let (known, answer) = self.0.borrow()[Self::slot(name)];
        (known == name).then_some(answer)
    }

    /// Remembers an answer.
    pub fn put(&self, name: NodeName, answer: T) {
        self.0.borrow_mut()[Self::slot(name)] = (name, answer);
    }
}

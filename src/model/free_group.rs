//! What a schedule knows of the groups it chooses from.

/// A group that is free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeGroup {
    /// Its number.
    pub group: u32,
    /// Predicted cost, any unit.
    pub cost: f64,
}

/// Who holds a group's clusters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Share of them that the asking worker holds, 0..=1.
    pub here: f64,
    /// Share that another worker holds and the asking one does not.
    pub elsewhere: f64,
}

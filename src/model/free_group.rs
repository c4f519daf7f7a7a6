//! What a schedule knows of the groups it chooses from.

/// A group that is free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeGroup {
    /// Its number.
    pub group: u32,
    /// Predicted cost, any unit.
    pub cost: f64,
    /// Share of its clusters that the asking worker holds, 0..=1.
    pub held_here: f64,
    /// Share that another worker holds and the asking one does not.
    pub held_elsewhere: f64,
}

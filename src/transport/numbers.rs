//! The numbers of the transport of light that were chosen, each with what it trades. What is not here follows from a formula.

// What is done about rows.

/// Share of the structure that is gone once an element is split.
pub const SPLIT_MENDS: f64 = 0.8;

/// Share of the noise that is gone with twice the rays.
pub const DOUBLING_MENDS: f64 = 0.5;

/// Rounds of a side's first rows.
pub const FIRST_ROUNDS: u16 = 2;

/// Rounds, at least, of the rows of elements that were split: fewer take noise for structure.
pub const LEAST_ROUNDS: u16 = 4;

/// Most rounds of a row.
pub const MOST_ROUNDS: u16 = 64;

/// Acts, one upon the other, that a row and those that come of it may see in one visit: what they promise is known only
/// as well as their rays tell.
pub const ACTS: u32 = 2;

/// Share of the excess error that is promised in one marking; with more, rays are cast for what others mend.
pub const MARKED: f64 = 0.4;

/// Rays of one marking, relative to all that have been cast: no fewer, since an iteration costs as much.
pub const LEAST_BUDGET: f64 = 0.1;

/// The same: no more, since rows say where the error is no better than their rays tell.
pub const MOST_BUDGET: f64 = 0.5;

/// Share of what the whole model emits from which on a side that emits is measured as finely as can be, and in quarters.
pub const BRIGHT: f64 = 0.125;

// What rows know of their error.

/// Noise of a mean, relative to what the halves differ by at a place over the number of places: half of that were rays random,
/// less since those of a half are spread evenly.
pub const NOISE_OF_MEAN: f64 = 0.25;

/// As how many more numbers that counts, beside what the halves' means differ by.
pub const NOISE_KNOWN: f64 = 4.0;

/// Standard errors from which on structure counts as found; what they are of it is taken off (James and Stein).
pub const FOUND: f64 = 1.5;

/// Places from which on a line is looked for; fewer have a mean alone.
pub const LEAST_OF_LINE: usize = 6;

// Rays to lamps.

/// Size of a lamp, in distances, below which its middle stands for it.
pub const SMALL_LAMP: f64 = 0.1;

/// Lamps and bundles that rays from a place are shared out among, but for those near by.
pub const CANDIDATES: usize = 12;

/// Size of a part of a lamp, in distances, below which its points bring about alike.
pub const ALIKE: f64 = 0.15;

/// Most cells across a lamp.
pub const MOST_CELLS: usize = 4;

// Places measured anew.

/// Rays of each half of a place to lamps, and over the hemisphere.
pub const CHECK_RAYS: [u64; 2] = [32, 128];

/// Squared error that is expected anywhere, relative to the light.
pub const CHECKED_ANYHOW: f64 = 1e-4;

/// Squared error that is expected anywhere, relative to that of the group: where none is expected it must not count for so
/// much when it is found.
pub const CHECKED_ANYWHERE: f64 = 0.2;

/// Share of the rays in rows that places measured anew may cost.
pub const CHECKED: f64 = 0.03;

/// Places measured anew in an iteration, at least.
pub const LEAST_CHECKED: f64 = 64.0;

// Points of `sample`, and paths.

/// Rays of a batch.
pub const BATCH: u64 = 32;

/// Batches, at least.
pub const LEAST_BATCHES: u64 = 4;

/// Batches, at most.
pub const MOST_BATCHES: u64 = 128;

/// Standard errors that are to lie within the tolerance.
pub const SURELY: f64 = 2.0;

/// Share of the paths that go on from a place at most, however much it reflects.
pub const MOST_GO_ON: f64 = 0.99;

// What an iteration does.

/// Share below which what is left is nothing: of the tolerance for what light is still to change, or its imbalance has drifted
/// in an iteration, since where reflectance is high it is a bias of everything alike; of what the last iteration changed for
/// what is left to change within a group; of the balance that is allowed.
pub const STILL: f64 = 0.1;

/// Share of what leaves that rows may miss, in tolerances; more is wrong, not rough.
pub const MOST_MISSED: f64 = 0.5;

/// Four times the links along hard edges of shadows leave 0.7 of the estimate; one that stays above this share has not
/// fallen, however few places tell.
pub const FALLS: f64 = 0.95;

/// Markings, one after another, that must have made the estimate fall.
pub const LEAST_PATIENCE: usize = 3;

/// The same where each does little.
pub const MOST_PATIENCE: usize = 16;

/// Share of places that counts in the next iteration: light has changed.
pub const KEPT: f64 = 0.8;

/// Share of the tolerance up to which what few rows have wrong together, and no place tells, may go round.
pub const TOGETHER: f64 = 0.25;

/// Energy balance beyond which light that no longer changes is wrong all the same: twice what is promised.
pub const BALANCED: f64 = 0.01;

/// Least excess that a marking aims at, in squared tolerances: what iterations cost is not worth less.
pub const LEAST_EXCESS: f64 = 0.15;

/// Share of the estimated error, or of the tolerance, below which what light still changes no longer hides what promises
/// most.
pub const SETTLED: f64 = 0.5;

// The norm of the error.

/// Brightness, in means, beyond which light counts no more.
pub const BRIGHTEST: f64 = 10.0;

/// Brightness, in means, below which a place is dark.
pub const DARK: f64 = 1e-3;

/// Brightness, in means, below which errors do not become more urgent.
pub const DIM: f64 = 1e-2;

// Rounding.

/// Below this (radius / distance)^2 a polygon counts as a small area seen from afar: the closed
/// form's edge terms cancel there, and the small-area formula errs by less than this ratio.
pub const FAR: f64 = 1e-6;

/// Least width of an element of two slopes, relative to its length and squared.
pub const NARROW: f64 = 1e-4;

/// What is no more than this beside what it is compared with is none.
pub const NOTHING: f64 = 1e-9;

/// The same where numbers come from stored ones, which have 24 bits.
pub const NOTHING_STORED: f64 = 1e-6;

/// Tangent of the angle up to which a series stands for an arc tangent: it errs by less than 4e-12.
pub const SMALL_ANGLE: f64 = 0.25;

/// Places on an edge this near to each other are one, as shares of it.
pub const SAME: f64 = 1e-5;

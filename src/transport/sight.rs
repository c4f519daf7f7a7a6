//! What a link is worth: form factor, visibility class, and how far both may be off.
//!
//! The shaft decides first: nothing in it, or a wall across it, are proofs that children inherit.
//! Only partial links cast rays: stratified, weighted by the kernel, seeded by the pair of names, few
//! first and more only while the outcome matters.

use super::cells::Cells;
use super::form_factor;
use super::oracle::Verdict;
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;
use crate::geom::sequence::{Sequence, mix};
use crate::model::links::Visibility;
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::shaft::{Blockers, Contents, ShaftEnd};

/// A link's numbers.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// Form factor receiver to source, visibility included.
    pub form_factor: f64,
    /// Largest deviation of that over the receiver.
    pub spread: f64,
    /// Standard error from sampled visibility.
    pub uncertainty: f64,
    /// What is known of the visibility.
    pub class: Visibility,
}

/// What a pair of nodes knows of what lies between them, and so between all below.
#[derive(Clone, Debug)]
pub struct Known<'a> {
    /// Whether they see each other.
    pub class: Visibility,
    /// All that may stand in between, where it has been named.
    pub blockers: Blockers<'a>,
}

impl Known<'_> {
    /// As a stored link knows it.
    #[must_use]
    pub fn stored(class: Visibility) -> Self {
        Self { class, blockers: None }
    }
}

/// How carefully to look.
#[derive(Clone, Copy, Debug)]
pub struct Care {
    /// Error of the form factor that does not matter, for a form factor of 1; for others it is less
    /// by their square root.
    pub allowed: f64,
    /// Whether the receiver may be split instead of casting more rays.
    pub can_split: bool,
    /// From `--seed`.
    pub seed: u64,
    /// Places to try whatever they tell; as many as matter if none.
    pub tries: Option<u64>,
}

impl Care {
    /// Error that an unoccluded form factor may have, for a source of so much area at such a distance.
    pub(super) fn tolerance(&self, area_m2: f64, distance_squared_m2: f64) -> f64 {
        let rough = (area_m2 / (std::f64::consts::PI * distance_squared_m2)).clamp(1e-8, 1.0);
        (0.1 * self.allowed * rough.sqrt()).clamp(1e-7, FORM_FACTOR_TOLERANCE)
    }
}

/// No form factor's error above this is let pass, however alike source and receiver are now.
const LARGEST_DOUBT: f64 = 0.002;

/// Rays of the first batch, and the most for one link.
const FIRST_RAYS: u64 = 8;
const MOST_RAYS: u64 = 256;

/// Most places that are tried for a ray: some see the source from behind.
const TRIES_PER_RAY: u64 = 4;

/// Coarsest tolerance of an unoccluded form factor: rows of some hundred links then close to 1e-3.
const FORM_FACTOR_TOLERANCE: f64 = 2e-4;

/// What was found out about a pair of nodes.
pub struct Look<'a> {
    /// What the receiver sees of the source.
    pub sight: Sight,
    /// What pairs below inherit.
    pub blockers: Blockers<'a>,
    /// What to do with the link.
    pub verdict: Verdict,
}

/// Sets the rays that count apart from those that decide.
const FRESH: u64 = 0x6672_6573_6800_0000;

/// Returns what the receiver `r` sees of the source `s`; `None` if they do not face each other.
/// `known` is inherited from a pair of nodes that holds this one. Counts rays in `rays`.
///
/// Rays that decide tell nothing of the light: where few meet the source they are believed, where more do the
/// link is refined or more are cast, and on average too little would arrive. So a link that `judge` keeps counts
/// as many others.
#[must_use]
pub fn look<'a>(
    scene: &RayScene<'a>,
    r: &Node,
    s: &Node,
    known: &Known<'a>,
    care: Care,
    judge: &dyn Fn(&Sight) -> Verdict,
    rays: &mut u64,
) -> Option<Look<'a>> {
    if !r.faces(s, scene.snap_m()) {
        return None;
    }
    let certain = |sight: Sight| Look { sight, blockers: None, verdict: judge(&sight) };
    let nothing = Sight { form_factor: 0.0, spread: 0.0, uncertainty: 0.0, class: Visibility::Hidden };
    if known.class == Visibility::Hidden {
        return Some(certain(nothing));
    }
    let tolerance = care.tolerance(s.shape.area(), r.shape.centre().distance_squared(s.shape.centre()));
    let open = form_factor::average(&r.shape, r.normal, &s.shape, s.normal, tolerance);
    let spread = (open.high - open.mean).max(open.mean - open.low);
    let clear = Sight { form_factor: open.mean, spread, uncertainty: open.error, class: Visibility::Visible };
    if known.class == Visibility::Visible {
        return Some(certain(clear));
    }
    match contents(scene, r, s, &known.blockers)? {
        Contents::Nothing => Some(certain(clear)),
        Contents::Wall => Some(certain(nothing)),
        Contents::Something(blockers) => {
            let (sight, verdict) = judged(care, judge, |care| sample(scene, [r, s], &clear, care, &blockers, rays));
            Some(Look { sight, blockers, verdict })
        }
    }
}

/// What lies between those parts of two elements that face each other; `None` if none do.
fn contents<'a>(scene: &RayScene<'a>, r: &Node, s: &Node, known: &Blockers<'a>) -> Option<Contents<'a>> {
    let (seen, seeing) = parts_that_face(r, s)?;
    let ends = [ShaftEnd { shape: &seeing, end: r.end }, ShaftEnd { shape: &seen, end: s.end }];
    Some(scene.shaft(ends[0], ends[1], known))
}

/// Whether nothing lies between two elements: `false` where that is not proved.
#[must_use]
pub fn sees_whole(scene: &RayScene<'_>, r: &Node, s: &Node) -> bool {
    parts_that_face(r, s).is_some_and(|(seen, seeing)| {
        let ends = [ShaftEnd { shape: &seeing, end: r.end }, ShaftEnd { shape: &seen, end: s.end }];
        scene.is_free(ends[0], ends[1])
    })
}

/// The parts of `s` and of `r` that face each other.
fn parts_that_face(r: &Node, s: &Node) -> Option<(Polygon, Polygon)> {
    let (seen, seeing) = (s.in_front_of(r), r.in_front_of(s));
    (seen.corners().len() >= 3 && seeing.corners().len() >= 3).then_some((seen, seeing))
}

/// The sight that decides what to do with a link; where the link is kept, as many other rays tell what counts.
pub(super) fn judged(
    care: Care,
    judge: &dyn Fn(&Sight) -> Verdict,
    mut sample: impl FnMut(Care) -> (Sight, u64),
) -> (Sight, Verdict) {
    let (sight, tries) = sample(care);
    let verdict = judge(&sight);
    if verdict != Verdict::Keep {
        return (sight, verdict);
    }
    (sample(Care { seed: care.seed ^ FRESH, tries: Some(tries), ..care }).0, verdict)
}

/// Share that n agreeing rays may have missed, times n: a quarter of what they are expected to.
pub const UNANIMOUS: f64 = 0.15;

/// Shares of visible rays, whole and per quarter of the receiver.
#[derive(Default)]
pub(super) struct Tally {
    weight: f64,
    weight_squared: f64,
    visible: f64,
    quarter_weight: [f64; 4],
    quarter_visible: [f64; 4],
    cast: u64,
}

impl Tally {
    pub(super) fn add(&mut self, quarter: usize, weight: f64, visible: bool) {
        let seen = if visible { weight } else { 0.0 };
        self.weight += weight;
        self.weight_squared += weight * weight;
        self.visible += seen;
        self.quarter_weight[quarter] += weight;
        self.quarter_visible[quarter] += seen;
        self.cast += 1;
    }

    fn share(&self) -> f64 {
        if self.weight > 0.0 { self.visible / self.weight } else { 0.0 }
    }

    /// Standard error of the share; where all rays agree, what they may well have missed.
    fn error(&self) -> f64 {
        if self.weight <= 0.0 {
            return 0.5;
        }
        let effective = self.weight * self.weight / self.weight_squared;
        let share = self.share();
        if share == 0.0 || share == 1.0 {
            return UNANIMOUS / (effective + 1.0);
        }
        (share * (1.0 - share) / (effective + 1.0)).sqrt()
    }

    /// Deviation of the quarters' shares that rays' noise does not explain.
    fn gradient(&self) -> f64 {
        let share = self.share();
        let noise = (share * (1.0 - share) * 4.0 / self.cast.max(4) as f64).sqrt();
        let deviation = (0..4)
            .filter(|q| self.quarter_weight[*q] > 0.0)
            .map(|q| (self.quarter_visible[q] / self.quarter_weight[q] - share).abs())
            .fold(0.0, f64::max);
        (deviation - noise).max(0.0)
    }
}

/// A mean of samples.
#[derive(Default)]
pub(super) struct Mean {
    pub(super) count: f64,
    pub(super) sum: f64,
    squares: f64,
}

impl Mean {
    pub(super) fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    /// Variance of the sum.
    pub(super) fn sum_variance(&self) -> f64 {
        (self.squares - self.sum * self.sum / self.count.max(1.0)).max(0.0)
    }
}

/// A sight by rays, and how many places were tried.
fn sample(
    scene: &RayScene<'_>,
    [r, s]: [&Node; 2],
    clear: &Sight,
    care: Care,
    blockers: &Blockers<'_>,
    rays: &mut u64,
) -> (Sight, u64) {
    let quarters: [_; 4] = std::array::from_fn(|q| quadtree::quarter(&r.shape, q as u32));
    let cells = Cells::new(r, s);
    let (low, high) = (r.name.min(s.name), r.name.max(s.name));
    let sequence = Sequence::new(mix(care.seed ^ mix(low.0)) ^ high.0);
    // Bounds the kernel in contact, where a few rays would else outweigh all others.
    let softening = 2e-3 * s.shape.area() / cells.count() as f64;
    cast(care, clear, |index, tally| {
        let [a, b, c, d] = sequence.point(index);
        let quarter = (index % 4) as usize;
        let from = quarters[quarter].point(a, b);
        let (to, density) = cells.draw(r, s, from, [c, d]);
        let along = to - from;
        let (cos_r, cos_s) = (r.normal.dot(along), -s.normal.dot(along));
        if cos_r <= 0.0 || cos_s <= 0.0 {
            return;
        }
        let distance_squared = along.length_squared();
        let weight = cos_r * cos_s / (distance_squared * (distance_squared + softening) * density);
        *rays += 1;
        let visible = !scene.blocked(from, to, &r.end, &s.end, blockers);
        tally.add(quarter, weight, visible);
    })
}

/// Casts rays by `ray` (given the number of the try), more of them while that matters: a sight, and how many places
/// were tried.
pub(super) fn cast(care: Care, clear: &Sight, mut ray: impl FnMut(u64, &mut Tally)) -> (Sight, u64) {
    let allowed = (care.allowed * clear.form_factor.sqrt()).min(LARGEST_DOUBT);
    let mut tally = Tally::default();
    let mut target = if care.tries.is_some() { u64::MAX } else { FIRST_RAYS };
    let mut tries = 0;
    loop {
        let most = care.tries.unwrap_or_else(|| TRIES_PER_RAY * target);
        while tries < most && tally.cast < target {
            ray(tries, &mut tally);
            tries += 1;
        }
        let (unoccluded, its_error) = (clear.form_factor, clear.uncertainty);
        let share = tally.share();
        let doubt = unoccluded * tally.error();
        let mixed = share > 0.0 && share < 1.0;
        if doubt <= allowed || (mixed && care.can_split) || target >= MOST_RAYS {
            let sight = Sight {
                form_factor: unoccluded * share,
                spread: clear.spread * share + unoccluded * tally.gradient(),
                uncertainty: doubt + its_error * share,
                class: Visibility::Partial,
            };
            return (sight, tries);
        }
        target *= 2;
    }
}

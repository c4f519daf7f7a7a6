//! Refinement of a cluster: rows for sides that have none, and what promises most for the error of the whole model.

use std::collections::{BTreeMap, BTreeSet};

use crate::base::{NodeName, PatchSide, Progress, Result, Rgb};
use crate::rays::RayScene;
use crate::rays::locate::Covering;
use crate::rays::node::Node;
use crate::transport::light::line::{Fit, Halves};
use crate::transport::light::lit::Lights;
use crate::transport::measure::lamps::LightTree;
use crate::transport::measure::{hemisphere, lamps};
use crate::transport::nodes::frame::{Frame, Plane};
use crate::transport::nodes::grading;
use crate::transport::nodes::mesh::{Mesh, MeshRow};
use crate::transport::nodes::places::{Draws, Places};
use crate::transport::norm::Norm;
use crate::transport::numbers;
use crate::transport::oracle::{Act, Case, rounds_of_children};
use crate::transport::row::{Found, Hit, Kept, Part, Row, add, scaled, slots};
use crate::transport::source::{ClusterView, Clusters, exitance};

/// What stays the same over a visit.
pub struct Context<'a> {
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// The version that is read.
    pub clusters: &'a dyn Clusters,
    /// Its light.
    pub lights: &'a dyn Lights,
    /// From `--seed`.
    pub seed: u64,
    /// What is done promises at least so much a ray; infinite where nothing is to be done.
    pub threshold: f64,
    /// What light counts.
    pub norm: Norm,
    /// What gathers are multiplied by.
    pub gain: [f32; 3],
    /// `--min-element`, m, or 0.
    pub min_element_m: f64,
    /// Bytes of rows made that are held before they are put away: never changes the result.
    pub made_bytes: u64,
    /// Where interruption is asked for.
    pub progress: &'a dyn Progress,
}

/// Takes rows that were made, in order, so that they need not be held.
pub type PutAway<'a> = dyn FnMut(&[Row]) -> Result<()> + 'a;

/// What refinement did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Rays cast.
    pub rays: u64,
    /// Entries that rays made.
    pub entries: u64,
}

/// The sides of a cluster, as rows measure them.
pub struct Sides {
    frames: Vec<Frame>,
    coverings: Vec<Covering>,
}

impl Sides {
    /// Of a cluster.
    #[must_use]
    pub fn of(view: &ClusterView<'_>, scene: &RayScene<'_>) -> Self {
        let side = |i: usize| Node::root(view.id, &view.geometry.patches[i / 2], PatchSide::from_index(i));
        Self {
            frames: view.geometry.patches.iter().map(Frame::of).collect(),
            coverings: (0..2 * view.geometry.patches.len()).map(|i| scene.covering(&side(i))).collect(),
        }
    }

    /// Faces that cover parts of a side.
    #[must_use]
    pub fn covering(&self, side: PatchSide) -> &Covering {
        &self.coverings[side.index()]
    }
}

/// An element as a row of it is measured and fitted.
pub struct Measured<'a> {
    node: Node,
    places: Places,
    frame: &'a Frame,
    centroid: Plane,
}

impl<'a> Measured<'a> {
    /// An element of a cluster.
    #[must_use]
    pub fn of(view: &ClusterView<'_>, sides: &'a Sides, name: NodeName, part: Part, seed: u64) -> Self {
        let side = name.patch_side();
        let node = Node::at(view.id, &view.geometry.patches[usize::from(side.patch)], name);
        let frame = &sides.frames[usize::from(side.patch)];
        let places = Places::of(&node, part, seed, sides.covering(side));
        Self { centroid: frame.plane(node.shape.centroid()), node, places, frame }
    }

    /// The line through what arrives at its places.
    #[must_use]
    pub fn fit(&self, rounds: u16, halves: &Halves) -> Fit {
        let mut corners = self.frame.corners(&self.node.shape);
        corners.iter_mut().for_each(|c| *c = [c[0] - self.centroid[0], c[1] - self.centroid[1]]);
        self.places.design(rounds, self.frame, self.centroid).fit(halves, &corners)
    }

    /// Bit i: place i is open.
    #[must_use]
    pub fn open(&self) -> u16 {
        self.places.open
    }
}

/// A row, and how good it is.
struct Worked {
    held: Held,
    rounds: u16,
    fit: Fit,
}

/// Where a row is.
enum Held {
    /// Where earlier visits left it, by number.
    Kept(usize),
    /// Here: it was made or changed.
    Made(Row),
    /// Put away: it was made or changed, and nothing more is to be done about it in this visit.
    Away,
}

/// A cluster whose rows are made.
pub struct Refined {
    /// Its elements, with the rows' lines by the light of the version that was read.
    pub mesh: Mesh,
    /// Rows that were made or changed and not put away, in order.
    pub made: Vec<Row>,
    /// Rows that are no more.
    pub gone: Vec<(NodeName, Part)>,
    /// What was done.
    pub counts: Counts,
}

/// What visibility knows of a cluster's surroundings.
#[derive(Default)]
pub struct Around {
    /// The lamps in sight.
    pub lamps: LightTree,
    /// Whether rays leave the model.
    pub escapes: bool,
    /// What all lamps of the model emit, W (norm over RGB).
    pub emitted_w: f64,
}

struct Refiner<'a, 'c> {
    context: &'a Context<'c>,
    view: ClusterView<'a>,
    sides: &'a Sides,
    around: &'a Around,
    mesh: Mesh,
    kept: &'a dyn Kept,
    rows: BTreeMap<(NodeName, Part), Worked>,
    gone: Vec<(NodeName, Part)>,
    /// Rows beside much finer ones: [`grading::uneven`].
    uneven: BTreeSet<(NodeName, Part)>,
    /// Rows that nothing more is to be done about and that were made since rows were put away, or more; and their bytes.
    done: Vec<(NodeName, Part)>,
    done_bytes: u64,
    counts: Counts,
}

/// Refines a cluster with rows as earlier visits left them. Those made go to `put_away` before they are too many.
pub fn refine(
    context: &Context<'_>,
    view: ClusterView<'_>,
    sides: &Sides,
    around: &Around,
    kept: &dyn Kept,
    put_away: &mut PutAway<'_>,
) -> Result<Refined> {
    let mesh = Mesh::load(view.id, view.geometry.patches, &view.light);
    let (mut rows, mut gone) = (BTreeMap::new(), Vec::new());
    for (number, key) in kept.keys().into_iter().enumerate() {
        match mesh.rows.binary_search_by_key(&key, |row| (mesh.elements[row.element as usize].name, row.part)) {
            Ok(at) => {
                let MeshRow { rounds, fit, .. } = mesh.rows[at];
                rows.insert(key, Worked { held: Held::Kept(number), rounds, fit });
            }
            // Those of other lamps.
            Err(_) => gone.push(key),
        }
    }
    let uneven = if context.threshold < f64::INFINITY {
        grading::uneven(&mesh, view.geometry.patches, &*context.lights.lit(view.id)?)
    } else {
        BTreeSet::new()
    };
    let counts = Counts::default();
    let mut refiner = Refiner {
        context,
        view,
        sides,
        around,
        mesh,
        kept,
        rows,
        gone,
        uneven,
        done: Vec::new(),
        done_bytes: 0,
        counts,
    };
    for MeshRow { element, part, rounds, fit } in std::mem::take(&mut refiner.mesh.rows) {
        let key = (refiner.mesh.elements[element as usize].name, part);
        if !refiner.rows.contains_key(&key) {
            // The light tells of it and nobody has kept it: it comes out as it was.
            refiner.measure(key.0, part, rounds)?;
            refiner.rows.get_mut(&key).expect("just made").fit = fit;
        }
        refiner.work_on(key)?;
        refiner.put_away(put_away)?;
    }
    refiner.begin(put_away)?;
    Ok(refiner.finish())
}

impl Refiner<'_, '_> {
    /// Gives rows to sides that have none.
    fn begin(&mut self, put_away: &mut PutAway<'_>) -> Result<()> {
        let mut done = vec![[false; 2]; 2 * self.view.geometry.patches.len()];
        for (name, part) in self.rows.keys() {
            done[name.patch_side().index()][*part as usize] = true;
        }
        let view = self.view;
        for (index, done) in done.into_iter().enumerate().filter(|(index, _)| view.takes_part(*index)) {
            let name = NodeName::root(self.view.id, PatchSide::from_index(index));
            for part in Part::ALL.into_iter().filter(|part| !done[*part as usize]) {
                let share = if part == Part::Indirect { self.share_of_open_lamp(index) } else { 0.0 };
                let whole = case(self.context, &view, &self.mesh, index, numbers::FIRST_ROUNDS, Fit::default());
                if share > numbers::BRIGHT && whole.may_be_split() {
                    self.mesh.split(index, &view.geometry.patches[index / 2]);
                    for quarter in 0..4 {
                        self.measure(name.child(quarter), part, numbers::MOST_ROUNDS)?;
                        self.work_on((name.child(quarter), part))?;
                    }
                    continue;
                }
                let rounds = ((share / numbers::BRIGHT).min(1.0) * f64::from(numbers::MOST_ROUNDS)) as u16;
                self.measure(name, part, rounds.max(numbers::FIRST_ROUNDS))?;
                self.work_on((name, part))?;
            }
            self.put_away(put_away)?;
        }
        Ok(())
    }

    /// Share of what the whole model emits that a side does, if rays leave the model: how much of it goes must be known
    /// well, since all of it counts in the balance.
    fn share_of_open_lamp(&self, side: usize) -> f64 {
        if !self.around.escapes || self.around.emitted_w <= 0.0 {
            return 0.0;
        }
        let exitance = Rgb::from_f32(self.view.materials[side].exitance).norm_squared().sqrt();
        exitance * self.mesh.elements[side].area_m2 / self.around.emitted_w
    }

    /// Measures a row of an element anew, or with more rounds than it has.
    fn measure(&mut self, name: NodeName, part: Part, rounds: u16) -> Result<()> {
        self.context.progress.go_on()?;
        let Context { scene, lights, seed, .. } = self.context;
        let measured = Measured::of(&self.view, self.sides, name, part, *seed);
        let draws = Draws::of(&measured.node, part, *seed);
        let before = self.rows.remove(&(name, part)).map(|worked| self.row(worked));
        let first = before.as_ref().map_or(0, |row| row.rounds);
        let found = match part {
            Part::Direct => {
                let cast =
                    lamps::cast(scene, &self.around.lamps, &measured.node, &measured.places, &draws, first..rounds);
                self.counts.rays += cast.rays;
                self.counts.entries += cast.shares.len() as u64;
                let mut shares = match before.map(|row| row.found) {
                    Some(Found::Shares(shares)) => shares,
                    _ => Vec::new(),
                };
                shares.extend(cast.shares);
                Found::Shares(shares)
            }
            Part::Indirect => {
                let cast = hemisphere::cast(scene, *lights, &measured.node, &measured.places, &draws, first..rounds)?;
                self.counts.rays += cast.len() as u64;
                self.counts.entries += cast.len() as u64;
                let mut hits = match before.map(|row| row.found) {
                    Some(Found::Hits(hits)) => hits,
                    _ => Vec::new(),
                };
                hits.extend(cast);
                Found::Hits(hits)
            }
        };
        let row = Row { element: name, part, rounds, open: measured.open(), found };
        let fit = measured.fit(rounds, &scaled(&self.halves(&row)?, self.context.gain));
        self.note(&row);
        self.rows.insert(row.key(), Worked { held: Held::Made(row), rounds, fit });
        Ok(())
    }

    fn row(&self, worked: Worked) -> Row {
        match worked.held {
            Held::Kept(number) => self.kept.row(number),
            Held::Made(row) => row,
            Held::Away => unreachable!("what was put away is done"),
        }
    }

    /// Notes a row that was made: it may be put away once the row that is being worked on is done.
    fn note(&mut self, row: &Row) {
        self.done.push(row.key());
        self.done_bytes += (row.len() * size_of::<Hit>()) as u64;
    }

    /// Puts rows away that were made and worked on, if they are many.
    fn put_away(&mut self, put_away: &mut PutAway<'_>) -> Result<()> {
        if self.done_bytes <= self.context.made_bytes {
            return Ok(());
        }
        self.done.sort_unstable();
        self.done.dedup();
        let mut rows = Vec::new();
        for key in self.done.drain(..) {
            if let Some(Worked { held, .. }) = self.rows.get_mut(&key)
                && let Held::Made(_) = held
                && let Held::Made(row) = std::mem::replace(held, Held::Away)
            {
                rows.push(row);
            }
        }
        self.done_bytes = 0;
        put_away(&rows)
    }

    /// What arrives over a row by the light of the version.
    fn halves(&self, row: &Row) -> Result<Halves> {
        let mut halves = Halves::default();
        let weight = 1.0 / f32::from(row.rounds.max(1));
        match &row.found {
            Found::Shares(shares) => {
                for share in shares {
                    let light = exitance(self.context.clusters, share.lamp)?;
                    add(&mut halves, usize::from(share.slot), light, share.factor * weight);
                }
            }
            Found::Hits(hits) => {
                for (hit, slot) in hits.iter().zip(slots(row.open)).filter(|(hit, _)| hit.side != NodeName::ESCAPE) {
                    let lit = self.context.lights.lit(hit.side.cluster())?;
                    add(&mut halves, slot, lit.leaving_from(hit.side.patch_side(), hit.at), weight);
                }
            }
        }
        Ok(halves)
    }

    /// Does what is worth it about a row, and about those that come of it.
    fn work_on(&mut self, key: (NodeName, Part)) -> Result<()> {
        if self.context.threshold == f64::INFINITY {
            return Ok(());
        }
        let mut open = vec![(key, 0u32)];
        while let Some(((name, part), acts)) = open.pop() {
            if acts >= numbers::ACTS {
                continue;
            }
            let Worked { rounds, fit, .. } = self.rows[&(name, part)];
            let at = self.mesh.nearest(name);
            let element = &self.mesh.elements[at];
            let case = case(self.context, &self.view, &self.mesh, at, rounds, fit);
            let offer = case.offer().filter(|offer| offer.rate() >= self.context.threshold);
            let is_uneven = self.uneven.contains(&(name, part)) && case.may_be_split();
            let Some(act) = is_uneven.then_some(Act::Split).or(offer.map(|offer| offer.act)) else { continue };
            match act {
                Act::Cast => {
                    self.measure(name, part, 2 * rounds)?;
                    open.push(((name, part), acts + 1));
                }
                Act::Split => {
                    if element.is_leaf() {
                        self.mesh.split(at, &self.view.geometry.patches[usize::from(name.patch_side().patch)]);
                    }
                    let worked = self.rows.remove(&(name, part)).expect("it is worked on");
                    let whole = self.row(worked);
                    self.gone.push((name, part));
                    let measured = Measured::of(&self.view, self.sides, name, part, self.context.seed);
                    for quarter in 0..4 {
                        let row = measured.places.of_child(&whole, quarter);
                        if row.rounds > 0 {
                            let (rounds, fit) = (row.rounds, Fit::default());
                            self.rows.insert(row.key(), Worked { held: Held::Made(row), rounds, fit });
                        }
                        self.measure(name.child(quarter), part, rounds_of_children(rounds))?;
                        open.push(((name.child(quarter), part), acts + 1));
                    }
                }
            }
        }
        Ok(())
    }

    fn finish(self) -> Refined {
        let Self { mut mesh, rows, mut gone, counts, .. } = self;
        gone.retain(|key| !rows.contains_key(key));
        let mut made = Vec::new();
        mesh.rows.clear();
        for ((name, part), Worked { held, rounds, fit }) in rows {
            mesh.rows.push(MeshRow { element: mesh.nearest(name) as u32, part, rounds, fit });
            if let Held::Made(row) = held {
                made.push(row);
            }
        }
        Refined { mesh, made, gone, counts }
    }
}

/// A row as a case for the oracle.
#[must_use]
pub fn case(context: &Context<'_>, view: &ClusterView<'_>, mesh: &Mesh, element: usize, rounds: u16, fit: Fit) -> Case {
    let of = &mesh.elements[element];
    let side = of.name.patch_side();
    let is_smallest = context.min_element_m > 0.0
        && Node::at(view.id, &view.geometry.patches[usize::from(side.patch)], of.name)
            .is_smallest(context.min_element_m);
    let bright_w_m2 = of.line.mean.norm_squared().max(fit.line.mean.norm_squared()).sqrt();
    Case {
        weight_m2: of.area_m2 * context.norm.counts(bright_w_m2).powi(2),
        urgency: context.norm.urgency(bright_w_m2),
        depth: of.name.depth(),
        is_smallest,
        rounds,
        fit,
    }
}

/// Sums over a cluster's leaves: what they receive, as the norm counts it.
#[must_use]
pub fn level(view: &ClusterView<'_>, mesh: &Mesh, norm: &Norm) -> [f64; 3] {
    let (mut squared, mut lit, mut area) = (0.0, 0.0, 0.0);
    for leaf in mesh.elements.iter().filter(|e| e.is_leaf() && !view.emits(e.name)) {
        let bright = leaf.line.mean.norm_squared().sqrt();
        if bright <= 0.0 {
            continue;
        }
        let counts = bright * norm.counts(bright);
        squared += leaf.area_m2 * counts.powi(2);
        if !norm.is_dark(bright) {
            lit += leaf.area_m2 * counts;
            area += leaf.area_m2;
        }
    }
    [squared, lit, area]
}

//! What must be true of an extent beyond its checksum; each function says what is not.

use super::cut::CutNode;
use super::geometry::{GeometryView, Seam, SideMaterial};
use super::light::LightView;
use super::links::LinksView;
use super::origin::{BakeCorner, PatchSource};
use super::rays::{ClusterRaysView, TopRaysView, WHOLE, hierarchy};
use super::visibility::VisibilityView;
use super::{Arrays, ExtentKind};
use crate::base::{ClusterId, NodeKind, NodeName};

fn ascending<T: PartialOrd>(items: impl IntoIterator<Item = T>) -> bool {
    let mut items = items.into_iter();
    let Some(mut last) = items.next() else { return true };
    items.all(|item| {
        let rises = last < item;
        last = item;
        rises
    })
}

/// Whether a name is one that an element of a cluster with so many patches can have: no index in it leads outside.
fn is_name(name: NodeName, patches: u32) -> bool {
    // A leading 1, then two bits a level.
    let path = name.path();
    let is_path = path != 0 && path.ilog2().is_multiple_of(2);
    name.kind() == Some(NodeKind::Element) && is_path && u32::from(name.patch_side().patch) < patches
}

/// Whether all names are of elements that clusters can have, or the escape; quick where neighbours are of one cluster.
fn are_names(names: &[u64], patches_of: &dyn Fn(u32) -> Option<u32>) -> bool {
    let mut last = (ClusterId::PSEUDO, None);
    names.iter().map(|&name| NodeName(name)).all(|name| {
        if name == NodeName::ESCAPE {
            return true;
        }
        if last.0 != name.cluster() {
            last = (name.cluster(), patches_of(name.cluster().0));
        }
        last.1.is_some_and(|patches| is_name(name, patches))
    })
}

fn ensure(holds: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(what()) }
}

/// Patches and seams of a cluster.
pub fn geometry(payload: &[u8], cluster: u32) -> Result<(), String> {
    let view = GeometryView::parse(payload)?;
    ensure(view.head.cluster == cluster, || format!("it says that it is cluster {}'s", view.head.cluster))?;
    for (i, patch) in view.patches.iter().enumerate() {
        ensure(matches!(patch.corner_count, 3 | 4), || format!("patch {i} has {} corners", patch.corner_count))?;
        let finite = patch.corners_m.iter().flatten().all(|x| x.is_finite());
        ensure(finite && patch.area_m2 > 0.0 && patch.face_area_m2 > 0.0, || {
            format!("patch {i} is not finite or has no area")
        })?;
    }
    let by_patch = view.seams.windows(2).all(|w| w[0].patch <= w[1].patch);
    ensure(by_patch, || "seams are out of order".to_owned())?;
    view.seams.iter().enumerate().try_for_each(|(i, s)| seam(&view, i, s))
}

/// Its edges are there, and places on them.
fn seam(view: &GeometryView<'_>, at: usize, seam: &Seam) -> Result<(), String> {
    let is_edge = |patch: u16, edge: u8| view.patches.get(usize::from(patch)).is_some_and(|p| edge < p.corner_count);
    let edges = is_edge(seam.patch, seam.edge) && is_edge(seam.other, seam.other_edge) && seam.patch != seam.other;
    ensure(edges, || format!("seam {at} has no edge"))?;
    let rises = |[a, b]: [f32; 2]| 0.0 <= a && a < b && b <= 1.0;
    let [a, b] = seam.other_along;
    ensure(rises(seam.along) && rises([b, a]) && seam.sides <= 3, || format!("seam {at} lies nowhere"))?;
    ensure(view.seams_of(seam.other).contains(&seam.turned()), || format!("seam {at} leads one way"))
}

/// Two materials per patch, with reflectance within 0..=1.
pub fn materials(payload: &[u8], patches: usize) -> Result<(), String> {
    let sides = Arrays::new(payload).get::<SideMaterial>(0)?;
    ensure(sides.len() == 2 * patches, || format!("{} materials for {patches} patches", sides.len()))?;
    for (i, side) in sides.iter().enumerate() {
        let reflects = side.rho.iter().all(|r| (0.0..=1.0).contains(r));
        let emits = side.exitance.iter().all(|e| e.is_finite() && *e >= 0.0);
        ensure(reflects && emits, || format!("side {i} reflects {:?} and emits {:?}", side.rho, side.exitance))?;
    }
    Ok(())
}

/// Both roots of every patch, four children or none, everything finite and not negative.
pub fn light(payload: &[u8], cluster: u32, patches: usize) -> Result<(), String> {
    let view = LightView::parse(payload)?;
    ensure(view.head.channels == 3, || format!("{} channels", view.head.channels))?;
    let roots = view.level(0).len();
    ensure(roots == 2 * patches, || format!("{roots} roots for {patches} patches"))?;
    for depth in 0..15 {
        let level = view.level(depth);
        ensure(ascending(level.iter().map(|e| e.name)), || format!("level {depth} is out of order"))?;
        ensure(depth == 0 || level.len() % 4 == 0, || format!("level {depth} has an element without its siblings"))?;
        for element in level {
            let name = NodeName(element.name);
            ensure(is_name(name, patches as u32), || format!("{name:?} is no name of its cluster"))?;
            let at_home = name.cluster().0 == cluster && name.depth() == depth;
            ensure(at_home, || format!("{name:?} does not belong on level {depth}"))?;
            ensure(name.parent().is_none_or(|p| view.find(p).is_some()), || format!("{name:?} has no parent"))?;
            let fine = element.irradiance.iter().all(|x| x.is_finite() && *x >= 0.0)
                && element.slope_u.iter().chain(&element.slope_v).all(|x| x.is_finite());
            ensure(fine, || format!("{name:?} receives {:?}", element.irradiance))?;
        }
    }
    ensure(ascending(view.rows.iter().map(|r| (r.name, r.part))), || "rows are out of order".to_owned())?;
    for row in view.rows {
        let name = NodeName(row.name);
        let is_own = is_name(name, patches as u32) && name.cluster().0 == cluster;
        ensure(is_own && view.find(name).is_some(), || format!("a row of {name:?}, which is not there"))?;
        ensure(row.part < 2 && row.rounds > 0, || format!("a row of {name:?} has no rays or part"))?;
        let fine = row.irradiance.iter().chain([&row.noise, &row.structure_error]).all(|x| x.is_finite() && *x >= 0.0)
            && row.slope_u.iter().chain(&row.slope_v).chain([&row.structure]).all(|x| x.is_finite());
        ensure(fine, || format!("a row of {name:?} receives {:?}", row.irradiance))?;
    }
    Ok(())
}

/// Rows and dictionary in order, form factors of lamps finite, as many hits as places and rounds.
pub fn links(payload: &[u8], cluster: u32, patches_of: &dyn Fn(u32) -> Option<u32>) -> Result<(), String> {
    let view = LinksView::parse(payload)?;
    ensure(ascending(view.rows.iter().map(|r| (r.element, r.part))), || "rows are out of order".to_owned())?;
    let mut names = view.rows.iter().map(|row| NodeName(row.element));
    let own = names.all(|n| n.cluster().0 == cluster && are_names(&[n.0], patches_of));
    ensure(own, || "a row is foreign".to_owned())?;
    ensure(ascending(view.sides), || "the dictionary of sides is out of order".to_owned())?;
    let whole = view.sides.iter().map(|&name| NodeName(name));
    let whole = whole.into_iter().all(|n| n == NodeName::ESCAPE || n.path() == 1);
    ensure(whole && are_names(view.sides, patches_of), || "the dictionary holds a name of no side".to_owned())?;
    let factors = view.shares.iter().all(|share| share.factor.is_finite() && share.factor >= 0.0);
    ensure(factors, || "a form factor is not a number".to_owned())?;
    let lamps = view.shares.iter().all(|s| view.sides[s.lamp()] != NodeName::ESCAPE.0);
    ensure(lamps, || "the escape is a lamp".to_owned())?;
    for row in view.rows.iter().filter(|row| row.part == 1) {
        let rays = 2 * u32::from(row.rounds) * row.open.count_ones();
        ensure(row.count == rays, || format!("{:?} met {} places with {rays} rays", NodeName(row.element), row.count))?;
    }
    Ok(())
}

/// Clusters in order, form factors within 0..=1.
pub fn visibility(payload: &[u8], patches_of: &dyn Fn(u32) -> Option<u32>) -> Result<(), String> {
    let view = VisibilityView::parse(payload)?;
    let known = view.clusters.iter().all(|c| patches_of(c.cluster).is_some());
    ensure(known, || "it lists a cluster that is not there".to_owned())?;
    ensure(ascending(view.clusters.iter().map(|c| c.cluster)), || "clusters are out of order".to_owned())?;
    let fractions = view.clusters.iter().all(|c| (0.0..=1.0).contains(&c.form_factor));
    ensure(fractions, || "a form factor lies outside 0..=1".to_owned())
}

/// Faces have shapes, what they fell into is there, no patch is met twice, and every node refers to what is there. A
/// cluster without faces is of parts of one that another cluster holds.
pub fn rays(payload: &[u8], cluster: u32, patches_of: &dyn Fn(u32) -> Option<u32>) -> Result<(), String> {
    let view = ClusterRaysView::parse(payload)?;
    let patches = patches_of(cluster).unwrap_or(0);
    let mut met = Vec::new();
    for face in view.patches {
        ensure(face.patch < patches, || format!("face {} is named by no patch", face.patch))?;
        let shaped = matches!(face.corner_count, 3 | 4) && face.corners_m.iter().flatten().all(|x| x.is_finite());
        ensure(shaped, || format!("face {} has no shape", face.patch))?;
        if face.cut == WHOLE {
            met.push(cluster << 8 | face.patch);
            continue;
        }
        let (nodes, parts) = view.cuts.of_face(face.cut).ok_or_else(|| format!("face {} has no cut", face.patch))?;
        cut_tree(nodes, parts.len()).map_err(|what| format!("the cuts of face {} {what}", face.patch))?;
        let is_named = parts.contains(&(cluster << 8 | face.patch));
        ensure(is_named, || format!("face {} is named by none of its parts", face.patch))?;
        met.extend_from_slice(parts);
    }
    met.sort_unstable();
    let there = |part: &u32| patches_of(part >> 8).is_some_and(|patches| part & 0xff < patches);
    ensure(ascending(met.iter().copied()) && met.iter().all(there), || "rays meet other patches".to_owned())?;
    let own = met.iter().filter(|part| *part >> 8 == cluster).count();
    ensure(own == patches as usize || view.patches.is_empty(), || format!("rays meet {own} of {patches} patches"))?;
    if view.patches.is_empty() && view.nodes.is_empty() { Ok(()) } else { hierarchy(view.nodes, view.patches.len()) }
}

/// Every node of a cut tree leads on, to nodes behind it or to parts.
fn cut_tree(nodes: &[CutNode], parts: usize) -> Result<(), String> {
    for (at, node) in nodes.iter().enumerate() {
        let leads_on = node.children.iter().all(|&child| match child & CutNode::PART {
            0 => at < child as usize && (child as usize) < nodes.len(),
            _ => ((child & !CutNode::PART) as usize) < parts,
        });
        ensure(leads_on && node.line.iter().all(|x| x.is_finite()), || format!("do not lead on from node {at}"))?;
    }
    ensure(parts > 0, || "have no parts".to_owned())
}

/// Clusters are met once, and every node refers to what is there.
pub fn rays_top(payload: &[u8]) -> Result<(), String> {
    let view = TopRaysView::parse(payload)?;
    hierarchy(view.nodes, view.clusters.len())?;
    let mut met: Vec<u32> = view.clusters.iter().map(|c| c.cluster).collect();
    met.sort_unstable();
    ensure(ascending(met), || "a cluster is met twice".to_owned())
}

/// What must be true of an extent of a kind; `patches_of` says how many patches a cluster has, if it is there.
pub fn of(
    kind: ExtentKind,
    payload: &[u8],
    cluster: u32,
    patches_of: &dyn Fn(u32) -> Option<u32>,
) -> Result<(), String> {
    let patches = patches_of(cluster).ok_or_else(|| format!("there is no cluster {cluster}"))? as usize;
    match kind {
        ExtentKind::Geometry => {
            let own = GeometryView::parse(payload)?.patches.len();
            ensure(own == patches, || format!("{own} patches where the catalogue says {patches}"))?;
            geometry(payload, cluster)
        }
        ExtentKind::Visibility => visibility(payload, patches_of),
        ExtentKind::Links => links(payload, cluster, patches_of),
        ExtentKind::Materials => materials(payload, patches),
        ExtentKind::Radiosity => light(payload, cluster, patches),
        ExtentKind::Rays => rays(payload, cluster, patches_of),
        ExtentKind::Bake => bake(payload, patches),
        ExtentKind::Provenance => provenance(payload, patches),
    }
}

/// Sources name patches of the cluster.
pub fn provenance(payload: &[u8], patches: usize) -> Result<(), String> {
    let arrays = Arrays::new(payload);
    let known = arrays.get::<PatchSource>(0)?.iter().all(|s| (s.patch as usize) < patches);
    ensure(known, || "a source names a patch that is not there".to_owned())
}

/// Corners name patches of the cluster.
pub fn bake(payload: &[u8], patches: usize) -> Result<(), String> {
    let corners = Arrays::new(payload).get::<BakeCorner>(0)?;
    ensure(corners.iter().all(|c| (c.corner as usize) < 4 * patches), || {
        "a corner names a patch that is not there".to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::super::layout::{ArraysBuilder, aligned};
    use super::super::links::{LinksHead, RowHead, StoredHit, StoredShare};
    use super::super::rays::{Cuts, FaceCut, RayNode, RayPatch};
    use super::*;

    /// A face of cluster 7 named by `patch`, in two parts.
    fn face_named(patch: u32, parts: [u32; 2]) -> Result<(), String> {
        let node = RayNode::EMPTY.with(0, ([0.0; 3], [1.0; 3]), 0, 1);
        let face = RayPatch { corners_m: [[0.0; 3]; 4], patch, corner_count: 4, area_m2: 1.0, cut: 0 };
        let cut = FaceCut { first_node: 0, nodes: 1, first_part: 0, parts: 2 };
        let line = CutNode { line: [1.0, 0.0, 0.0], children: [CutNode::PART, CutNode::PART | 1] };
        let cuts = Cuts { faces: &[cut], nodes: &[line], parts: &parts };
        let payload = aligned(&ClusterRaysView { nodes: &[node], patches: &[face], cuts }.payload());
        rays(bytemuck::cast_slice(&payload), 7, &|cluster| (cluster < 9).then_some(2))
    }

    #[test]
    fn a_face_is_named_by_one_of_its_own_parts() {
        let own = [7 << 8, 7 << 8 | 1];
        assert_eq!(face_named(0, own), Ok(()));
        assert!(face_named(2, own).unwrap_err().contains("named by no patch"));
        // As a number that is the first patch of the next cluster, where it has a part.
        assert!(face_named(256, [7 << 8, 8 << 8]).unwrap_err().contains("named by no patch"));
        assert!(face_named(1, [7 << 8, 8 << 8]).unwrap_err().contains("none of its parts"));
    }

    /// A row of cluster 7 of what 2 rays from one place met: a side.
    fn row_of(element: NodeName, hits: u32, side: NodeName) -> Result<(), String> {
        let head = LinksHead { delta: 0, reserved: 0, rows: 1, shares: 0, hits: u64::from(hits) };
        let (element, count) = (element.0, hits);
        let row = RowHead { element, first: 0, count, part: 1, rounds: 1, open: 0x10, reserved: [0; 3] };
        let met = vec![StoredHit { side: 0, at: [0; 2] }; hits as usize];
        let arrays = ArraysBuilder::default().with(&[head]).with(&[row]).with(&[side.0]);
        let payload = aligned(&arrays.with::<StoredShare>(&[]).with(&met).finish());
        links(bytemuck::cast_slice(&payload), 7, &|_| Some(2))
    }

    /// Of a reserved kind.
    const RESERVED: NodeName = NodeName(7 << 40 | 1 << 38);

    #[test]
    fn rows_are_those_of_elements() {
        let root = NodeName::root(ClusterId(7), crate::base::PatchSide { patch: 1, side: 0 });
        assert_eq!(row_of(root, 2, root), Ok(()));
        assert_eq!(row_of(root.child(3), 2, NodeName::ESCAPE), Ok(()));
        assert!(row_of(RESERVED, 2, root).unwrap_err().contains("foreign"));
        assert!(row_of(NodeName::root(ClusterId(8), root.patch_side()), 2, root).unwrap_err().contains("foreign"));
    }

    #[test]
    fn rays_meet_whole_sides_as_many_as_were_cast() {
        let root = NodeName::root(ClusterId(7), crate::base::PatchSide { patch: 1, side: 0 });
        assert!(row_of(root, 3, root).unwrap_err().contains("met 3 places with 2 rays"));
        assert!(row_of(root, 2, root.child(0)).unwrap_err().contains("no side"));
        assert!(row_of(root, 2, RESERVED).unwrap_err().contains("no side"));
    }

    #[test]
    fn lamps_are_sides() {
        let root = NodeName::root(ClusterId(7), crate::base::PatchSide { patch: 1, side: 0 });
        let lit_by = |lamp: NodeName, factor: f32| {
            let head = LinksHead { delta: 0, reserved: 0, rows: 1, shares: 1, hits: 0 };
            let (element, open) = (root.0, u16::MAX);
            let row = RowHead { element, first: 0, count: 1, part: 0, rounds: 1, open, reserved: [0; 3] };
            let arrays = ArraysBuilder::default().with(&[head]).with(&[row]).with(&[lamp.0]);
            let share = StoredShare::new(0, 0, 31, factor);
            let payload = aligned(&arrays.with(&[share]).with::<StoredHit>(&[]).finish());
            links(bytemuck::cast_slice(&payload), 7, &|_| Some(2))
        };
        assert_eq!(lit_by(root, 0.5), Ok(()));
        assert!(lit_by(NodeName::ESCAPE, 0.5).unwrap_err().contains("the escape is a lamp"));
        assert!(lit_by(root, f32::NAN).unwrap_err().contains("not a number"));
    }
}

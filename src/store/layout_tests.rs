//! The sizes that `schema/SEGMENTS.md` states are those of the records.

use super::extent_header::ExtentHeader;
use crate::model::geometry::{ClusterHead, PatchRecord, SectorHead, SideMaterial, TreeNode};
use crate::model::light::{ElementLight, LightHead, SectorLight};
use crate::model::links::{LeafClosure, LinksHead};
use crate::model::origin::{BakeCorner, PatchSource};
use crate::model::rays::{ClusterRef, RayNode, RayPatch};
use crate::model::visibility::{VisibilityHead, VisibleCluster};

#[test]
fn records_have_the_sizes_that_the_format_page_states() {
    let page = include_str!("../../schema/SEGMENTS.md");
    // By the first words of each record's sentence on the page.
    let records = [
        ("Head", size_of::<ClusterHead>()),
        ("Patch", size_of::<PatchRecord>()),
        ("Tree node", size_of::<TreeNode>()),
        ("Sector node", size_of::<SectorHead>()),
        ("Side", size_of::<SideMaterial>()),
        ("Head", size_of::<VisibilityHead>()),
        ("Cluster", size_of::<VisibleCluster>()),
        ("Head", size_of::<LightHead>()),
        ("Sector node", size_of::<SectorLight>()),
        ("Element", size_of::<ElementLight>()),
        ("Head", size_of::<LinksHead>()),
        ("Closure", size_of::<LeafClosure>()),
        ("Node", size_of::<RayNode>()),
        ("Patch", size_of::<RayPatch>()),
        ("Cluster reference", size_of::<ClusterRef>()),
        ("Corner", size_of::<BakeCorner>()),
        ("Source", size_of::<PatchSource>()),
    ];
    let mut rest = page;
    for (name, bytes) in records {
        let sentence = format!("{name}, {bytes} bytes");
        let Some(at) = rest.find(&sentence) else { panic!("the page does not say `{sentence}` next") };
        rest = &rest[at + sentence.len()..];
    }
    assert_eq!(size_of::<ExtentHeader>(), 64);
}

//! The readers, one target each: whether they read an input to its end is for the report, what they may not
//! do is panic or hang.

use std::path::Path;

use clerestory::base::{NodeName, text};
use clerestory::formats::points::PointReader;
use clerestory::formats::{mtl, obj};
use clerestory::geom::cut_tree::part_at;
use clerestory::geom::split::split;
use clerestory::model::geometry::{GeometryView, Seam};
use clerestory::model::light::LightView;
use clerestory::model::links::{LinksView, for_each_row};
use clerestory::model::rays::{ClusterRaysView, TopRaysView};
use clerestory::model::report::TaskReport;
use clerestory::model::{ExtentKind, invariants};
use clerestory::rays::RayScene;
use clerestory::rays::emitters::NO_EMITTERS;
use clerestory::store::extent_header::ExtentHeader;
use glam::DVec3;
use xxhash_rust::xxh3::xxh3_64;

use super::corpus;

/// A reader and what to try it with.
pub struct Target {
    /// As `--target` names it.
    pub name: &'static str,
    /// What mutations begin with.
    pub corpus: Vec<Vec<u8>>,
    /// Words that mean something to it.
    pub words: &'static [&'static str],
    /// Makes an input pass the outermost check, so that what lies behind is tried too.
    pub seal: Option<fn(&mut [u8])>,
    /// Reads; whether it read to the end.
    pub read: fn(&[u8]) -> bool,
}

const OBJ_WORDS: &[&str] = &[
    "v ",
    "vt ",
    "vn ",
    "f ",
    "fo ",
    "o ",
    "g ",
    "usemtl ",
    "mtllib ",
    "l ",
    "p ",
    "curv ",
    "surf ",
    "\\\n",
    "\\\r",
    "//",
    "/",
    "-1",
    "99999999999",
    "-9223372036854775808",
    "4294967296",
    "1e400",
    "nan",
    "1.#INF",
    "#",
];
const MTL_WORDS: &[&str] = &[
    "newmtl ", "Kd ", "Ke ", "kd ", "Ks ", "Tr ", "d ", "map_Kd ", "map_", "bump ", "spectral", "xyz", "1e400", "nan",
    "-1", "1.#IND", "0,5", "#",
];
const POINT_WORDS: &[&str] = &[
    "x",
    "nx",
    ",",
    ";",
    "\t",
    "\"",
    "\"\"",
    "\r\n",
    "\n\"",
    "0,5",
    "nan",
    "1e400",
    "-",
    "#",
    "\u{feff}",
    "end of the points",
];
const TEXT_WORDS: &[&str] = &["\\x", "\\u{", "}", "\\\\", "\u{1b}", "\u{202e}", "110000"];

/// All targets.
pub fn all() -> Vec<Target> {
    let text = |of: &[&str]| of.iter().map(|t| t.as_bytes().to_vec()).collect();
    let extent = |name, bytes, read| Target { name, corpus: vec![bytes], words: &[], seal: None, read };
    let header = |kind| bytemuck::bytes_of(&ExtentHeader::new(kind, 7, 0, &corpus::geometry(), 100, 5)).to_vec();
    vec![
        Target { name: "obj", corpus: text(corpus::OBJ), words: OBJ_WORDS, seal: None, read: read_obj },
        Target { name: "mtl", corpus: text(corpus::MTL), words: MTL_WORDS, seal: None, read: read_mtl },
        Target { name: "points", corpus: text(corpus::POINTS), words: POINT_WORDS, seal: None, read: read_points },
        Target {
            name: "text",
            corpus: text(&["wall", "a\\\\b\\xe9\\u{1b}"]),
            words: TEXT_WORDS,
            seal: None,
            read: read_text,
        },
        Target { name: "polygon", corpus: corpus::polygons(), words: &[], seal: None, read: read_polygon },
        Target {
            name: "header",
            corpus: ExtentKind::ALL.map(header).to_vec(),
            words: &[],
            seal: Some(seal_header),
            read: read_header,
        },
        extent("geometry", corpus::geometry(), read_geometry),
        extent("materials", corpus::materials(), |bytes| aligned(bytes, |b| invariants::materials(b, 2).is_ok())),
        extent("light", corpus::light(), read_light),
        extent("links", corpus::links(), read_links),
        extent("visibility", corpus::visibility(), |bytes| {
            aligned(bytes, |b| invariants::visibility(b, &|_| Some(64)).is_ok())
        }),
        extent("rays", corpus::rays(), read_rays),
        extent("top-rays", corpus::top_rays(), read_top_rays),
        extent("provenance", corpus::provenance(), |bytes| aligned(bytes, |b| invariants::provenance(b, 2).is_ok())),
        extent("bake", corpus::bake(), |bytes| aligned(bytes, |b| invariants::bake(b, 2).is_ok())),
        extent("report", TaskReport::default().encode(), |bytes| TaskReport::decode(bytes).is_ok()),
    ]
}

/// Extents lie aligned in memory.
fn aligned<T>(bytes: &[u8], read: impl FnOnce(&[u8]) -> T) -> T {
    let mut words = vec![0u128; bytes.len().div_ceil(16)];
    let room = bytemuck::cast_slice_mut::<u128, u8>(&mut words);
    room[..bytes.len()].copy_from_slice(bytes);
    read(&room[..bytes.len()])
}

fn read_obj(bytes: &[u8]) -> bool {
    let Ok(mut reader) = obj::ObjReader::new(bytes, Path::new("fuzz.obj")) else { return false };
    while let Ok(record) = reader.next_record() {
        if record.is_none() {
            return true;
        }
    }
    false
}

fn read_mtl(bytes: &[u8]) -> bool {
    let Ok(library) = mtl::parse(bytes, Path::new("fuzz.mtl")) else { return false };
    let fine = |x: &f64| x.is_finite() && *x >= 0.0;
    assert!(library.materials.iter().all(|m| m.kd.iter().chain(&m.ke).all(fine)), "a colour that cannot be");
    true
}

fn read_points(bytes: &[u8]) -> bool {
    let Ok(points) = PointReader::new(bytes, Path::new("fuzz.csv")) else { return false };
    let mut fine = true;
    for point in points {
        fine &= point.is_ok();
    }
    fine
}

fn read_text(bytes: &[u8]) -> bool {
    assert_eq!(text::from_stored(&text::stored(bytes)).as_deref(), Some(bytes), "other bytes came back");
    let shown = text::shown_name(bytes);
    assert!(!shown.contains(char::is_control), "{shown:?}");
    std::str::from_utf8(bytes).is_ok_and(|t| text::from_stored(t).is_some())
}

fn read_polygon(bytes: &[u8]) -> bool {
    let numbers: Vec<f64> =
        bytes.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect();
    // Ingest takes nothing else.
    let points: Vec<DVec3> = numbers
        .chunks_exact(3)
        .map(DVec3::from_slice)
        .filter(|p| p.is_finite() && p.abs().max_element() < 1e9)
        .collect();
    if points.len() < 3 {
        return false;
    }
    let pieces = split(&points, 1e-5);
    assert!(pieces.iter().flat_map(|p| p.corners()).all(|i| *i < points.len()), "a corner that is not there");
    true
}

fn seal_header(bytes: &mut [u8]) {
    if let Some(hashed) = bytes.get(..56) {
        let hash = xxh3_64(hashed).to_le_bytes();
        if let Some(place) = bytes.get_mut(56..64) {
            place.copy_from_slice(&hash);
        }
    }
}

fn read_header(bytes: &[u8]) -> bool {
    ExtentHeader::parse(bytes).is_ok_and(|header| header.extent_kind().is_some())
}

fn read_geometry(bytes: &[u8]) -> bool {
    aligned(bytes, |bytes| {
        let is_sound = GeometryView::parse(bytes).is_ok() && invariants::geometry(bytes, 7).is_ok();
        if is_sound {
            let view = GeometryView::parse(bytes).expect("parsed before");
            let is_there = |seam: &Seam| usize::from(seam.patch.max(seam.other)) < view.patches.len();
            assert!(view.seams.iter().all(is_there), "a patch that is not there");
        }
        is_sound
    })
}

fn read_light(bytes: &[u8]) -> bool {
    aligned(bytes, |bytes| {
        let Ok(view) = LightView::parse(bytes) else { return false };
        for element in view.elements {
            let name = NodeName(element.name);
            std::hint::black_box((view.find(name), view.nearest(name), view.has_children(name)));
        }
        invariants::light(bytes, 7, 2).is_ok()
    })
}

fn read_links(bytes: &[u8]) -> bool {
    aligned(bytes, |bytes| {
        let Ok(view) = LinksView::parse(bytes) else { return false };
        for_each_row(&[view], |_, row| {
            let (shares, hits) = view.entries(row);
            let is_there = |side: u32| (side as usize) < view.sides.len();
            assert!(
                shares.iter().all(|s| is_there(s.lamp() as u32)) && hits.iter().all(|h| is_there(h.side)),
                "{row:?}"
            );
        });
        invariants::links(bytes, 7, &|_| Some(64)).is_ok()
    })
}

fn read_rays(bytes: &[u8]) -> bool {
    aligned(bytes, |bytes| {
        let is_sound = invariants::rays(bytes, 7, &|_| Some(3)).is_ok();
        if is_sound {
            let view = ClusterRaysView::parse(bytes).expect("it is sound");
            for (nodes, parts) in view.patches.iter().filter_map(|face| view.cuts.of_face(face.cut)) {
                assert!((part_at(nodes, [0, 1], DVec3::ZERO) as usize) < parts.len());
            }
        }
        is_sound
    })
}

fn read_top_rays(bytes: &[u8]) -> bool {
    aligned(bytes, |bytes| {
        let makes_scene = |top| RayScene::new(top, bytes, &NO_EMITTERS, 1e-3).is_ok();
        invariants::rays_top(bytes).is_ok() && TopRaysView::parse(bytes).is_ok_and(makes_scene)
    })
}

//! What things are made of.

use std::fmt::Write;

/// A material of the building.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "they speak for themselves")]
pub enum Material {
    Plaster,
    CeilingTile,
    Carpet,
    Lino,
    Stone,
    Facade,
    Oak,
    Beech,
    White,
    Steel,
    Black,
    BlueCloth,
    GreenCloth,
    OrangeCloth,
    RedCover,
    GreenCover,
    BlueCover,
    OchreCover,
    GreyCover,
    PaleCover,
    Lamp,
}

use Material as M;

/// Covers of books.
pub const COVERS: [Material; 6] = [M::RedCover, M::GreenCover, M::BlueCover, M::OchreCover, M::GreyCover, M::PaleCover];
/// Cloths of chairs.
pub const CLOTHS: [Material; 3] = [M::BlueCloth, M::GreenCloth, M::OrangeCloth];

/// Diffuse reflectances in order of [`Material`]; the lamp, which comes last, emits besides.
const TABLE: [(Material, &str, [f64; 3]); 21] = [
    (M::Plaster, "plaster", [0.78, 0.77, 0.73]),
    (M::CeilingTile, "ceiling_tile", [0.84, 0.84, 0.82]),
    (M::Carpet, "carpet", [0.26, 0.29, 0.33]),
    (M::Lino, "lino", [0.42, 0.39, 0.33]),
    (M::Stone, "stone", [0.5, 0.48, 0.44]),
    (M::Facade, "facade", [0.55, 0.42, 0.34]),
    (M::Oak, "oak", [0.52, 0.36, 0.21]),
    (M::Beech, "beech", [0.66, 0.52, 0.36]),
    (M::White, "white", [0.8, 0.8, 0.8]),
    (M::Steel, "steel", [0.45, 0.46, 0.48]),
    (M::Black, "black", [0.05, 0.05, 0.055]),
    (M::BlueCloth, "blue_cloth", [0.12, 0.2, 0.42]),
    (M::GreenCloth, "green_cloth", [0.16, 0.34, 0.2]),
    (M::OrangeCloth, "orange_cloth", [0.6, 0.28, 0.1]),
    (M::RedCover, "red_cover", [0.5, 0.1, 0.09]),
    (M::GreenCover, "green_cover", [0.13, 0.3, 0.16]),
    (M::BlueCover, "blue_cover", [0.13, 0.2, 0.45]),
    (M::OchreCover, "ochre_cover", [0.58, 0.42, 0.16]),
    (M::GreyCover, "grey_cover", [0.3, 0.3, 0.32]),
    (M::PaleCover, "pale_cover", [0.7, 0.67, 0.58]),
    (M::Lamp, "lamp", [0.6, 0.6, 0.6]),
];

/// Radiance of lamps, W/(m2 sr): some 500 lx on a desk.
const LAMP_RADIANCE: [f64; 3] = [28.0, 26.5, 24.0];

impl Material {
    /// Its name in OBJ and MTL.
    #[must_use]
    pub fn name(self) -> &'static str {
        TABLE[self as usize].1
    }
}

/// All materials as the text of an MTL file.
#[must_use]
pub fn library() -> String {
    let mut text = String::from("# Kd: diffuse reflectance; Ke: emitted radiance, W/(m2 sr).\n");
    for (material, name, kd) in TABLE {
        let [r, g, b] = kd;
        writeln!(text, "\nnewmtl {name}\nKd {r} {g} {b}").expect("a string takes all");
        if material == M::Lamp {
            let [r, g, b] = LAMP_RADIANCE;
            writeln!(text, "Ke {r} {g} {b}").expect("a string takes all");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_the_order_of_materials() {
        for (i, (material, ..)) in TABLE.iter().enumerate() {
            assert_eq!(*material as usize, i, "{}", material.name());
        }
    }
}

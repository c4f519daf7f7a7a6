//! The table of leaves: one row per leaf element and side.

use std::io::{self, Write};

/// Column names.
pub const HEADER: &str = "cluster,patch,side,path,x,y,z,nx,ny,nz,area_m2,\
radiosity_r_w_m2,radiosity_g_w_m2,radiosity_b_w_m2,\
irradiance_r_w_m2,irradiance_g_w_m2,irradiance_b_w_m2,illuminance_lx";

/// A leaf.
pub struct LeafRow {
    /// Cluster, patch, side (0 front, 1 back), path.
    pub name: [u32; 4],
    /// Centroid, model coordinates and units.
    pub centroid: [f64; 3],
    /// Unit normal of the side.
    pub normal: [f64; 3],
    /// Area, m2.
    pub area_m2: f64,
    /// What leaves it, W/m2.
    pub radiosity: [f32; 3],
    /// What arrives at it, W/m2.
    pub irradiance: [f32; 3],
    /// The same, lx.
    pub illuminance_lx: f32,
}

/// Writes a row; numbers are the shortest decimals that read back to the same value.
pub fn write(row: &LeafRow, out: &mut dyn Write) -> io::Result<()> {
    let [cluster, patch, side, path] = row.name;
    write!(out, "{cluster},{patch},{side},{path}")?;
    for x in row.centroid.iter().chain(&row.normal).chain([&row.area_m2]) {
        // -0 is 0.
        write!(out, ",{}", x + 0.0)?;
    }
    for x in row.radiosity.iter().chain(&row.irradiance).chain([&row.illuminance_lx]) {
        write!(out, ",{}", x + 0.0)?;
    }
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back_to_the_same_value_and_fit_the_header() {
        let row = LeafRow {
            name: [7, 2, 1, 27],
            centroid: [0.1 + 0.2, -0.0, 1e-7],
            normal: [0.0, 0.0, -1.0],
            area_m2: 1.0 / 3.0,
            radiosity: [0.1, 1e-9, 16_777_216.0],
            irradiance: [1.5; 3],
            illuminance_lx: 268.5,
        };
        let mut out = Vec::new();
        write(&row, &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        let cells: Vec<&str> = text.trim().split(',').collect();
        assert_eq!(cells.len(), HEADER.split(',').count());
        assert_eq!(cells[4].parse::<f64>().unwrap(), 0.1 + 0.2);
        assert_eq!(cells[5], "0");
        assert_eq!(cells[12].parse::<f32>().unwrap(), 1e-9);
        assert_eq!(HEADER.matches(' ').count(), 0);
    }
}

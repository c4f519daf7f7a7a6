//! A scene of `data/`, solved by the program in a folder of its own, and its numbers.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// A row of the table of leaves.
#[derive(Clone, Copy, Debug)]
pub struct Leaf {
    /// Cluster, patch, side (0 front, 1 back), path.
    pub name: [u32; 4],
    /// Centre, m.
    pub centre: [f64; 3],
    /// Normal of the side.
    pub normal: [f64; 3],
    /// Area, m2.
    pub area_m2: f64,
    /// What leaves it, W/m2.
    pub radiosity: [f64; 3],
    /// What arrives at it, W/m2.
    pub irradiance: [f64; 3],
}

/// A solved scene.
pub struct Solved {
    dir: tempfile::TempDir,
    /// The model's name, and what it was solved with.
    pub title: String,
    /// The summary of `run`.
    pub summary: Value,
}

/// A file of `data/`.
pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name)
}

/// Numbers of a table of `data/` by their column, one per row.
pub fn column(table: &str, name: &str) -> Vec<f64> {
    let mut lines = table.lines();
    let at = lines.next().unwrap().split(',').position(|c| c == name).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

/// A table of `data/`.
pub fn table(name: &str) -> String {
    std::fs::read_to_string(data(name)).unwrap()
}

/// Solves `data/MODEL.obj` with further flags of `run`.
pub fn solve(model: &str, flags: &[&str]) -> Solved {
    solve_file(&data(&format!("{model}.obj")), None, flags)
}

/// The same with materials that replace the model's: those of MTL text.
pub fn solve_with(model: &str, materials: &str, flags: &[&str]) -> Solved {
    solve_file(&data(&format!("{model}.obj")), Some(materials), flags)
}

/// Solves a model with one task at a time, and has `check` look at the store: rows hold what their rays found, light is
/// finite and not negative.
pub fn solve_file(model: &Path, materials: Option<&str>, flags: &[&str]) -> Solved {
    solve_to(&[0], model, materials, flags)
}

/// The same for a run that ends with one of some exit codes: 3 where the energy balance may be off by more than 1 %.
pub fn solve_to(codes: &[i32], model: &Path, materials: Option<&str>, flags: &[&str]) -> Solved {
    let dir = tempfile::tempdir().unwrap();
    let mut title = model.file_stem().unwrap().to_str().unwrap().to_owned();
    let mut command = Command::new(env!("CARGO_BIN_EXE_clerestory"));
    command.current_dir(dir.path()).arg("run").arg(model).args(["--store", "s.clr", "--workers", "1", "--json"]);
    if let Some(materials) = materials {
        std::fs::write(dir.path().join("own.mtl"), materials).unwrap();
        command.args(["--materials", "own.mtl"]);
    }
    for flag in flags {
        write!(title, " {flag}").unwrap();
    }
    let out = command.args(flags).output().unwrap();
    let code = out.status.code().unwrap_or(-1);
    assert!(codes.contains(&code), "{title}: exit code {code}: {}", String::from_utf8_lossy(&out.stderr));
    let solved = Solved { dir, title, summary: serde_json::from_slice(&out.stdout).unwrap() };
    solved.ask(&["check", "s.clr"]);
    solved
}

/// Materials that reflect `rho`; those named emit exitance 1 W/m2 times a factor besides.
pub fn grey(rho: f64, emitters: &[(&str, f64)]) -> String {
    let mut text = format!("newmtl *\nKd {rho} {rho} {rho}\n");
    for (name, exitance) in emitters {
        let radiance = exitance / std::f64::consts::PI;
        writeln!(text, "newmtl {name}\nKd {rho} {rho} {rho}\nKe {radiance} {radiance} {radiance}").unwrap();
    }
    text
}

impl Solved {
    /// The store's folder.
    pub fn store(&self) -> PathBuf {
        self.dir.path().join("s.clr")
    }

    /// Writes a file into the folder that the store lies in.
    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.dir.path().join(name), text).unwrap();
    }

    /// What the program prints when asked.
    pub fn ask(&self, args: &[&str]) -> String {
        let mut command = Command::new(env!("CARGO_BIN_EXE_clerestory"));
        let out = command.args(args).current_dir(self.dir.path()).output().unwrap();
        assert!(out.status.success(), "{} {args:?}: {}", self.title, String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    }

    /// Irradiance (first channel) at points, W/m2: lines of `x,y,z,nx,ny,nz`.
    pub fn irradiance_at(&self, points: &str) -> Vec<f64> {
        self.sample(points, "irradiance_r_w_m2")
    }

    /// A column of what `sample` answers at the points of a table.
    pub fn sample(&self, points: &str, name: &str) -> Vec<f64> {
        std::fs::write(self.dir.path().join("points.csv"), points).unwrap();
        column(&self.ask(&["sample", "s.clr", "--points", "points.csv", "-o", "-", "--quiet"]), name)
    }

    /// All leaves.
    pub fn leaves(&self) -> Vec<Leaf> {
        let text = self.ask(&["export", "s.clr", "-o", "-", "--quiet"]);
        text.lines()
            .skip(1)
            .map(|line| {
                let cells: Vec<f64> = line.split(',').map(|c| c.parse().unwrap()).collect();
                let three = |at: usize| [cells[at], cells[at + 1], cells[at + 2]];
                Leaf {
                    name: std::array::from_fn(|i| cells[i] as u32),
                    centre: three(4),
                    normal: three(7),
                    area_m2: cells[10],
                    radiosity: three(11),
                    irradiance: three(14),
                }
            })
            .collect()
    }
}

/// Area mean of a quantity.
pub fn mean<'a>(leaves: impl IntoIterator<Item = &'a Leaf>, of: impl Fn(&Leaf) -> f64) -> f64 {
    let (mut sum, mut area) = (0.0, 0.0);
    for leaf in leaves {
        sum += leaf.area_m2 * of(leaf);
        area += leaf.area_m2;
    }
    assert!(area > 0.0, "no leaves to average");
    sum / area
}

/// Irradiance, first channel.
pub fn irradiance(leaf: &Leaf) -> f64 {
    leaf.irradiance[0]
}

/// Radiosity, first channel.
pub fn radiosity(leaf: &Leaf) -> f64 {
    leaf.radiosity[0]
}

/// Area mean of the irradiance on the fronts of an object (`o` line) of `data/MODEL.obj`; clusters keep
/// the order of objects.
pub fn mean_on(model: &str, object: &str, leaves: &[Leaf]) -> f64 {
    let obj = table(&format!("{model}.obj"));
    let objects: Vec<&str> = obj.lines().filter_map(|l| l.strip_prefix("o ")).collect();
    let cluster = objects.iter().position(|o| *o == object).unwrap_or_else(|| panic!("{model} has no {object}"));
    mean(leaves.iter().filter(|l| l.name[0] == cluster as u32 && l.name[2] == 0), irradiance)
}

/// What is not as it should be, all of a test's at once; and the number nearest to its limit, printed
/// with `--nocapture`.
#[derive(Default)]
pub struct Wrong {
    found: Vec<String>,
    nearest: Option<(f64, String)>,
}

impl Wrong {
    /// Expects a number within a share of itself.
    pub fn relative(&mut self, name: &str, got: f64, expected: f64, share: f64) {
        let (error, limit) = ((got - expected).abs(), share * expected.abs());
        self.at_most(error, limit, || {
            format!("{name}: {got} for {expected}, {:+.3} %", 100.0 * (got / expected - 1.0))
        });
    }

    /// Expects a number that is at most its limit.
    pub fn at_most(&mut self, got: f64, limit: f64, what: impl Fn() -> String) {
        let used = if got > 0.0 { got / limit } else { 0.0 };
        if self.nearest.as_ref().is_none_or(|n| used > n.0) {
            self.nearest = Some((used, what()));
        }
        // A NaN is wrong too.
        if got.is_nan() || got > limit {
            self.found.push(what());
        }
    }

    /// Fails with all that is wrong.
    pub fn assert_none(self) {
        if let Some((used, what)) = &self.nearest {
            println!("nearest to its limit, {used:.2} of it: {what}");
        }
        let listed = self.found.len().min(40);
        assert!(self.found.is_empty(), "{} are wrong:\n{}", self.found.len(), self.found[..listed].join("\n"));
    }
}

//! Every verb and flag, once: parser, help, man page and completions come from here.

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::PossibleValue;
use clap::{Args, Parser, Subcommand, ValueEnum};

use super::values::{PictureSize, Triple, degrees, length, memory, seconds, share, size};
use crate::base::memory::MemoryBudget;
use crate::model::order::UpdateOrder;
use crate::model::solve_options::InnerOption;
use crate::stages::ingest::Units;
use crate::stages::partition::Method;
use crate::stages::solve_group::Policy;

/// Values of flags that other rooms name; what these say of them is no part of the help.
macro_rules! by_name {
    ($($values:ty: $($value:ident),+;)+) => {$(
        impl ValueEnum for $values {
            fn value_variants<'a>() -> &'a [Self] {
                &[$(Self::$value),+]
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                Some(PossibleValue::new(self.name()))
            }
        }
    )+};
}

by_name! {
    Units: M, Cm, Mm, In, Ft;
    Method: Merge, Split, Region, Random;
    UpdateOrder: Jacobi, Replace, Sequential;
}

/// Largest number that the catalogue holds.
const MOST: u64 = i64::MAX as u64;

/// Compute the diffuse global illumination of buildings far larger than memory
#[derive(Parser, Debug)]
#[command(name = "clerestory", version, disable_help_subcommand = true, arg_required_else_help = true)]
pub struct Cli {
    #[command(flatten)]
    pub common: Common,
    #[command(subcommand)]
    pub verb: Verb,
}

/// Flags of every verb.
#[derive(Args, Debug)]
#[command(next_help_heading = "Everywhere")]
pub struct Common {
    /// Anonymous memory of each process, e.g. 2G
    #[arg(long, global = true, value_name = "SIZE", default_value = "512M", value_parser = memory)]
    pub memory: MemoryBudget,
    /// Wait this long for a busy store, s
    #[arg(long, global = true, value_name = "SECONDS", default_value = "30", value_parser = seconds)]
    pub wait: Duration,
    /// Print one JSON document on stdout
    #[arg(long, global = true)]
    pub json: bool,
    /// Show progress on stderr; auto is a bar on a terminal, else a line every 30 s
    #[arg(long, global = true, value_name = "HOW", default_value = "auto")]
    pub progress: ProgressMode,
    /// Say nothing but errors
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Say more: settings and where they come from
    #[arg(short, long, global = true)]
    pub verbose: bool,
}

/// `--progress`.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgressMode {
    Auto,
    Bar,
    Plain,
    Json,
    None,
}

#[derive(Subcommand, Debug)]
pub enum Verb {
    /// Run everything from model to converged solution; resumes on an existing store
    #[command(
        after_help = "Examples:\n  clerestory run office.obj\n  clerestory run office.obj --quality final --workers 4"
    )]
    Run(Box<RunArgs>),
    /// Read models into a store: clusters, patches, version 0
    #[command(
        after_help = "Examples:\n  clerestory ingest office.clr office.obj\n  clerestory ingest office.clr walls.obj lamps.obj --units cm"
    )]
    Ingest(IngestArgs),
    /// Find which clusters may exchange light, with estimated form factors
    #[command(
        after_help = "Examples:\n  clerestory visibility office.clr\n  clerestory visibility office.clr --missing 0.001"
    )]
    Visibility(VisibilityArgs),
    /// Divide the clusters into groups
    #[command(
        after_help = "Examples:\n  clerestory partition office.clr\n  clerestory partition office.clr --method split --groups 40"
    )]
    Partition(PartitionArgs),
    /// Solve one group, the next free one, or go on while one is free
    #[command(
        after_help = "Examples:\n  clerestory solve-group office.clr --next\n  clerestory solve-group office.clr --until-done --quality draft"
    )]
    SolveGroup(SolveGroupArgs),
    /// Publish finished updates as new solution versions
    #[command(after_help = "Examples:\n  clerestory merge office.clr\n  clerestory merge office.clr --json")]
    Merge(MergeArgs),
    /// Say where the work is, what is running, what is next
    #[command(after_help = "Examples:\n  clerestory status office.clr\n  clerestory status office.clr --settings")]
    Status(StatusArgs),
    /// Verify every checksum, reference and invariant; names each damage
    #[command(after_help = "Examples:\n  clerestory check office.clr\n  clerestory check office.clr --json")]
    Check(StoreArgs),
    /// Remove old solution versions and unused bytes
    #[command(after_help = "Examples:\n  clerestory gc office.clr\n  clerestory gc office.clr --keep 5 --dry-run")]
    Gc(GcArgs),
    /// Give irradiance and lux at sensor points
    #[command(
        after_help = "Examples:\n  clerestory sample office.clr --points desk.csv -o lux.csv\n  clerestory sample office.clr --points grid.pts -o - --tolerance 0.005\n  clerestory sample office.clr --points desk.csv --stored -o stored.csv"
    )]
    Sample(SampleArgs),
    /// Measure the stored light anew at random places, and say how far it is off
    #[command(
        after_help = "Examples:\n  clerestory audit office.clr\n  clerestory audit office.clr --places 65536 --seed 2 --json"
    )]
    Audit(AuditArgs),
    /// Draw the solution as seen from a camera
    #[command(
        after_help = "Examples:\n  clerestory render office.clr -o office.png\n  clerestory render office.clr -o desk.hdr --eye 2,3,1.6 --look 5,3,1"
    )]
    Render(RenderArgs),
    /// Write the adaptive mesh with its light as GLB, PLY or CSV
    #[command(
        after_help = "Examples:\n  clerestory export office.clr -o office.glb\n  clerestory export office.clr -o light.csv --version 12"
    )]
    Export(ExportArgs),
    /// Print the completions of a shell
    #[command(
        after_help = "Examples:\n  clerestory completions bash > clerestory.bash\n  clerestory completions zsh > _clerestory"
    )]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page
    #[command(after_help = "Examples:\n  clerestory man | man -l -\n  clerestory man > clerestory.1")]
    Man,
    /// Explain a verb, or `exit-codes`
    #[command(after_help = "Examples:\n  clerestory help exit-codes\n  clerestory help ingest")]
    Help {
        /// A verb, or `exit-codes`
        topic: Option<String>,
    },
}

#[derive(Args, Debug)]
pub struct StoreArgs {
    /// Store folder
    pub store: PathBuf,
}

#[derive(Args, Debug)]
pub struct RunArgs {
    /// OBJ files; may be left out on an existing store
    #[arg(value_name = "MODEL.obj", required_unless_present = "store")]
    pub models: Vec<PathBuf>,
    /// Store folder [default: in the current folder, after the first model]
    #[arg(long, value_name = "STORE")]
    pub store: Option<PathBuf>,
    #[command(flatten)]
    pub ingest: IngestFlags,
    #[command(flatten)]
    pub visibility: VisibilityFlags,
    /// Group clusters by
    #[arg(long, value_name = "METHOD", help_heading = "Partition")]
    pub partition: Option<Method>,
    #[command(flatten)]
    pub groups: GroupsFlag,
    #[command(flatten)]
    pub solve: SolveFlags,
    #[command(flatten)]
    pub schedule: ScheduleFlags,
    /// Stop after this many iterations, with exit code 3
    #[arg(long, value_name = "N", default_value = "200", value_parser = clap::value_parser!(u64).range(1..))]
    pub max_iterations: u64,
    /// Ends of iterations kept per branch, version 0 besides
    #[arg(long, value_name = "N", default_value = "10", value_parser = clap::value_parser!(u64).range(1..=MOST))]
    pub keep: u64,
    /// Places audited at the end; 0 leaves the audit out
    #[arg(long, value_name = "N", default_value = "256", value_parser = clap::value_parser!(u64).range(..=MOST))]
    pub audit: u64,
    #[command(flatten)]
    pub workers: WorkersFlag,
    #[command(flatten)]
    pub seed: SeedFlag,
    /// Solution version to go on from [default: newest]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=MOST))]
    pub version: Option<u64>,
    #[command(flatten)]
    pub writing: WritingFlags,
}

#[derive(Args, Debug)]
pub struct IngestArgs {
    /// Store folder
    pub store: PathBuf,
    /// OBJ files
    #[arg(value_name = "MODEL.obj", required = true)]
    pub models: Vec<PathBuf>,
    #[command(flatten)]
    pub flags: IngestFlags,
    #[command(flatten)]
    pub writing: WritingFlags,
}

/// Flags that shape what ingest makes.
#[derive(Args, Debug)]
#[command(next_help_heading = "Ingest")]
pub struct IngestFlags {
    /// Length unit of the model: OBJ has none
    #[arg(long, value_name = "UNIT", default_value = "m")]
    pub units: Units,
    /// The model's vertical; auto: the axis with the most area facing along it
    #[arg(long, value_name = "AXIS", default_value = "auto")]
    pub up: Up,
    /// Sides that reflect
    #[arg(long, default_value = "both")]
    pub sides: Sides,
    /// Definitions that replace those of the same name, `*` all others
    #[arg(long, value_name = "FILE.mtl")]
    pub materials: Option<PathBuf>,
    /// Sides that emitters shine from; front: where the winding normal points
    #[arg(long, value_name = "SIDES", default_value = "front")]
    pub emit: Emit,
    /// Faces per cluster before contact lines cut them, at most 256; larger objects are split in space
    #[arg(long, value_name = "N", default_value = "64", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub max_cluster_patches: u32,
    /// Faces this near coincide, m or with a unit [default: 1e-5 of the bounding diagonal, at most 1 mm]
    #[arg(long, value_name = "LENGTH", value_parser = length)]
    pub snap: Option<f64>,
    /// What ends this near to a patch stands on it: its outline cuts the patch
    #[arg(long, value_name = "LENGTH", default_value = "1cm", value_parser = length)]
    pub contact: f64,
    /// Contact lines shorter than this are left inside elements
    #[arg(long, value_name = "LENGTH", default_value = "5cm", value_parser = length)]
    pub least_contact: f64,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
pub enum Up {
    Auto,
    Y,
    Z,
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    Both,
    Front,
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Emit {
    Front,
    Both,
}

#[derive(Args, Debug)]
pub struct VisibilityArgs {
    /// Store folder
    pub store: PathBuf,
    #[command(flatten)]
    pub flags: VisibilityFlags,
    #[command(flatten)]
    pub workers: WorkersFlag,
    #[command(flatten)]
    pub seed: SeedFlag,
    #[command(flatten)]
    pub writing: WritingFlags,
}

#[derive(Args, Debug)]
#[command(next_help_heading = "Visibility")]
pub struct VisibilityFlags {
    /// How to look for pairs of clusters that see each other
    #[arg(long, default_value = "sampled")]
    pub method: VisibilityMethod,
    /// Form-factor mass per cluster that may stay unseen (Good-Turing estimate)
    #[arg(long, value_name = "X", default_value = "0.005", value_parser = share)]
    pub missing: f64,
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum VisibilityMethod {
    Sampled,
}

#[derive(Args, Debug)]
pub struct PartitionArgs {
    /// Store folder
    pub store: PathBuf,
    /// Group clusters by [default: merge, or as they are]
    #[arg(long)]
    pub method: Option<Method>,
    #[command(flatten)]
    pub groups: GroupsFlag,
    #[command(flatten)]
    pub writing: WritingFlags,
}

#[derive(Args, Debug)]
pub struct GroupsFlag {
    /// Least number of groups [default: from the model and --memory]
    #[arg(long, value_name = "N", help_heading = "Partition", value_parser = clap::value_parser!(u32).range(1..))]
    pub groups: Option<u32>,
}

#[derive(Args, Debug)]
pub struct SolveGroupArgs {
    /// Store folder
    pub store: PathBuf,
    #[command(flatten)]
    pub which: Which,
    #[command(flatten)]
    pub flags: SolveFlags,
    #[command(flatten)]
    pub schedule: ScheduleFlags,
    #[command(flatten)]
    pub seed: SeedFlag,
    /// Solution version to go on from [default: newest]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=MOST))]
    pub version: Option<u64>,
    /// Print what would be done
    #[arg(long)]
    pub dry_run: bool,
}

#[derive(Args, Debug)]
#[group(required = true, multiple = false)]
pub struct Which {
    /// Solve this group
    #[arg(long, value_name = "G")]
    pub group: Option<u32>,
    /// Solve the next free group
    #[arg(long)]
    pub next: bool,
    /// Go on while a group of this iteration is free (a worker)
    #[arg(long)]
    pub until_done: bool,
}

#[derive(Args, Debug)]
#[command(next_help_heading = "Solve")]
pub struct SolveFlags {
    /// Largest error of the irradiance, nRMS [default: that of --quality]
    #[arg(long, value_name = "T", value_parser = share)]
    pub tolerance: Option<f64>,
    /// Tolerance 0.1, 0.05, 0.02 or 0.01
    #[arg(long, default_value = "standard")]
    pub quality: Quality,
    /// No element edge below this, m or with a unit [default: none]
    #[arg(long, value_name = "LENGTH", value_parser = length)]
    pub min_element: Option<f64>,
    /// Gathers per visit of a group, or `converge` (the paper: 2)
    #[arg(long, value_name = "N|converge", default_value = "converge")]
    pub inner: InnerOption,
    /// Keep links on disk, or discard them after each visit as the paper does
    #[arg(long, default_value = "keep")]
    pub links: LinkStorage,
    /// Links held in memory, e.g. 64M
    #[arg(long, value_name = "SIZE", default_value = "32M", value_parser = size)]
    pub link_cache: u64,
    /// When updates become versions: jacobi: all groups of an iteration at once; replace: one by one;
    /// sequential: Gauss-Seidel
    #[arg(long, default_value = "jacobi")]
    pub order: UpdateOrder,
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    Preview,
    Draft,
    Standard,
    Final,
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkStorage {
    Keep,
    Discard,
}

#[derive(Args, Debug)]
#[command(next_help_heading = "Schedule")]
pub struct ScheduleFlags {
    /// Which group a free worker takes: ffd: the costliest; ws: what it holds already; ffd-ws: both
    #[arg(long, value_name = "POLICY", default_value = "ffd-ws")]
    pub schedule: Schedule,
    /// Places that ffd-ws may leave the order of cost
    #[arg(long, value_name = "D", default_value = "16")]
    pub delta: u32,
}

impl ScheduleFlags {
    #[must_use]
    pub fn policy(&self) -> Policy {
        match self.schedule {
            Schedule::Ffd => Policy::Ffd,
            Schedule::Ws => Policy::Ws,
            Schedule::FfdWs => Policy::FfdWs { delta: self.delta },
        }
    }
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Schedule {
    Ffd,
    Ws,
    FfdWs,
}

#[derive(Args, Debug)]
pub struct WorkersFlag {
    /// Worker processes [default: number of cores]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub workers: Option<u32>,
}

#[derive(Args, Debug)]
pub struct SeedFlag {
    /// Every random number derives from it and from names
    #[arg(long, value_name = "N", default_value = "1")]
    pub seed: u64,
}

/// Flags of the stages that write a store.
#[derive(Args, Debug)]
pub struct WritingFlags {
    /// Drop the results of this stage and of later ones; on `run` and `ingest`: empty the store
    #[arg(long)]
    pub fresh: bool,
    /// Print what would be done
    #[arg(long)]
    pub dry_run: bool,
}

#[derive(Args, Debug)]
pub struct MergeArgs {
    /// Store folder
    pub store: PathBuf,
    /// Print what would be done
    #[arg(long)]
    pub dry_run: bool,
}

#[derive(Args, Debug)]
pub struct StatusArgs {
    /// Store folder
    pub store: PathBuf,
    /// Print each setting and where it comes from
    #[arg(long)]
    pub settings: bool,
}

#[derive(Args, Debug)]
pub struct GcArgs {
    /// Store folder
    pub store: PathBuf,
    /// Ends of iterations kept per branch, version 0 besides
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u64).range(1..=MOST))]
    pub keep: u64,
    /// Print what would be done
    #[arg(long)]
    pub dry_run: bool,
}

/// Where a picture, mesh or table goes.
#[derive(Args, Debug)]
pub struct OutputFlags {
    /// File to write; `-` is stdout
    #[arg(short, long, value_name = "FILE", required = true)]
    pub output: PathBuf,
    /// Overwrite the file
    #[arg(long)]
    pub force: bool,
    /// Print what would be done
    #[arg(long)]
    pub dry_run: bool,
}

#[derive(Args, Debug)]
pub struct SampleArgs {
    /// Store folder
    pub store: PathBuf,
    /// Points: CSV with header x,y,z,nx,ny,nz, or Radiance .pts; `-` is stdin
    #[arg(long, value_name = "P.csv", required = true)]
    pub points: PathBuf,
    #[command(flatten)]
    pub output: OutputFlags,
    /// Read what the stored solution says there, instead of measuring at each point; it says nothing of points on no
    /// surface
    #[arg(long)]
    pub stored: bool,
    /// Largest error of a gather, relative to what arrives at its point [default: that of the version]
    #[arg(long, value_name = "T", value_parser = share)]
    pub tolerance: Option<f64>,
    /// Points this near to a surface that faces their way are on it, others in the open, m or with a unit [default: 1e-5
    /// of the bounding diagonal, at most 1 mm]
    #[arg(long, value_name = "LENGTH", value_parser = length)]
    pub snap: Option<f64>,
    /// Solution version [default: newest]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=MOST))]
    pub version: Option<u64>,
}

#[derive(Args, Debug)]
pub struct AuditArgs {
    /// Store folder
    pub store: PathBuf,
    /// Places audited
    #[arg(long, value_name = "N", default_value = "4096", value_parser = clap::value_parser!(u64).range(1..=MOST))]
    pub places: u64,
    #[command(flatten)]
    pub seed: SeedFlag,
    /// Solution version [default: newest]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=MOST))]
    pub version: Option<u64>,
    /// Print what would be done
    #[arg(long)]
    pub dry_run: bool,
}

#[derive(Args, Debug)]
pub struct RenderArgs {
    /// Store folder
    pub store: PathBuf,
    #[command(flatten)]
    pub output: OutputFlags,
    /// Where the camera stands, model coordinates [default: the whole from above, ceilings cut]
    #[arg(long, value_name = "X,Y,Z", requires = "look", allow_hyphen_values = true)]
    pub eye: Option<Triple>,
    /// Where it looks
    #[arg(long, value_name = "X,Y,Z", requires = "eye", allow_hyphen_values = true)]
    pub look: Option<Triple>,
    /// Vertical field of view, degrees
    #[arg(long, value_name = "DEG", default_value = "60", value_parser = degrees, requires = "eye")]
    pub fov: f64,
    /// Pixels
    #[arg(long, value_name = "WxH", default_value = "1024x768")]
    pub size: PictureSize,
    /// What is up in the picture [default: the model's vertical]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "eye")]
    pub view_up: Option<Triple>,
    /// Solution version [default: newest]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=MOST))]
    pub version: Option<u64>,
}

#[derive(Args, Debug)]
pub struct ExportArgs {
    /// Store folder
    pub store: PathBuf,
    #[command(flatten)]
    pub output: OutputFlags,
    /// Solution version [default: newest]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=MOST))]
    pub version: Option<u64>,
}

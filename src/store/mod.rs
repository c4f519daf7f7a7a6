//! The scene store: a catalogue in SQLite and bulk data in mapped segment files. Only I/O.
//!
//! `catalogue` opens a store; `segment` writes and `extent` reads bulk data; `snapshot` reads one
//! solution version; `ingest_rows`, `stage_rows` and `partition_rows` take the results of stages;
//! `branches`, `tasks`, `workers` and `merging` carry the iterations; `garbage` takes away what
//! nobody reads.

pub mod audits;
pub mod branches;
pub mod catalogue;
mod connection;
mod coordinator;
pub mod extent;
pub mod extent_header;
mod files;
#[cfg(test)]
pub mod fixture;
pub mod folder;
mod garbage;
pub mod ingest_rows;
pub mod inventory;
pub mod iterations;
#[cfg(test)]
mod layout_tests;
pub mod locks;
pub mod merging;
pub mod model_facts;
pub mod mounts;
mod object_names;
mod old_versions;
mod ownership;
pub mod partition_rows;
pub mod processes;
pub mod reserve;
mod row_rules;
mod schema;
mod seals;
pub mod segment;
pub mod snapshot;
mod sql;
pub mod stage_rows;
pub mod stored_rays;
#[cfg(test)]
mod task_tests;
pub mod tasks;
pub mod workers;

pub use catalogue::Store;
pub use extent::{Extent, ExtentRef};
pub use ingest_rows::{ClusterRow, IngestTx};
pub use iterations::{Iteration, SolveSettings};
pub use locks::RunLock;
pub use model_facts::ModelFacts;
pub use processes::ProcessGuard;
pub use segment::SegmentWriter;
pub use snapshot::Snapshot;
pub use stage_rows::{Stage, StageRecord};
pub use tasks::{GroupClaim, Lease, Offer, UpdateRow};
pub use workers::Worker;

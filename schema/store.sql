-- The catalogue of a scene store: what there is and where its bytes lie. Elements, links and
-- visibility pairs live in segment files only. Times are Unix seconds (UTC), lengths metres.
-- An extent is (segment, offset of its header, bytes of its payload).

CREATE TABLE model (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    origin_x REAL NOT NULL, origin_y REAL NOT NULL, origin_z REAL NOT NULL, -- model units
    metres_per_unit REAL NOT NULL,
    up TEXT NOT NULL CHECK (up IN ('y', 'z')),
    min_x_m REAL NOT NULL, min_y_m REAL NOT NULL, min_z_m REAL NOT NULL, -- from the origin
    max_x_m REAL NOT NULL, max_y_m REAL NOT NULL, max_z_m REAL NOT NULL,
    snap_m REAL NOT NULL,
    sides TEXT NOT NULL CHECK (sides IN ('both', 'front')),
    emit TEXT NOT NULL CHECK (emit IN ('front', 'both')),
    patches INTEGER NOT NULL,
    patches_uncut INTEGER NOT NULL, -- before contact lines cut them
    crossings INTEGER NOT NULL, contacts INTEGER NOT NULL, outlines INTEGER NOT NULL, -- cuts, by cause
    clusters INTEGER NOT NULL,
    emitters INTEGER NOT NULL, -- uncut
    input_polygons INTEGER NOT NULL,
    area_m2 REAL NOT NULL,
    mean_patch_area_m2 REAL NOT NULL,
    emitted_r_w REAL NOT NULL, emitted_g_w REAL NOT NULL, emitted_b_w REAL NOT NULL,
    mean_reflectance REAL NOT NULL,
    max_reflectance REAL NOT NULL,
    rays_top_segment INTEGER NOT NULL, rays_top_offset INTEGER NOT NULL, rays_top_bytes INTEGER NOT NULL
) STRICT;

CREATE TABLE segments (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    file TEXT NOT NULL UNIQUE,
    purpose TEXT NOT NULL,
    published_bytes INTEGER NOT NULL DEFAULT 0 -- what lies behind is garbage
) STRICT;

CREATE TABLE stages (
    name TEXT PRIMARY KEY,
    input_hash TEXT NOT NULL,
    materials_hash TEXT NOT NULL,
    options_hash TEXT NOT NULL,
    previous_hash TEXT NOT NULL,
    options TEXT NOT NULL, -- JSON: the options that shape the result
    generation INTEGER NOT NULL,
    finished_at REAL NOT NULL
) STRICT;

CREATE TABLE settings (
    stage TEXT NOT NULL,
    name TEXT NOT NULL,
    value TEXT NOT NULL,
    PRIMARY KEY (stage, name)
) STRICT, WITHOUT ROWID;

-- Paths and names are bytes, here as text: UTF-8 as it is, other bytes as \xe9, control characters as
-- \u{1b}, and a backslash doubled, so that different bytes are different text (src/base/text.rs).

CREATE TABLE input_files (
    id INTEGER PRIMARY KEY,
    path TEXT NOT NULL,
    kind TEXT NOT NULL,
    bytes INTEGER NOT NULL,
    hash TEXT NOT NULL
) STRICT;

CREATE TABLE objects (
    id INTEGER PRIMARY KEY,
    file INTEGER NOT NULL REFERENCES input_files (id),
    name TEXT NOT NULL
) STRICT;

CREATE TABLE skipped_faces (
    file INTEGER NOT NULL REFERENCES input_files (id),
    line INTEGER NOT NULL,
    cause TEXT NOT NULL
) STRICT;

CREATE TABLE clusters (
    id INTEGER PRIMARY KEY,
    object INTEGER NOT NULL REFERENCES objects (id),
    patches INTEGER NOT NULL CHECK (patches BETWEEN 1 AND 256),
    emitters INTEGER NOT NULL,
    area_m2 REAL NOT NULL,
    min_x_m REAL NOT NULL, min_y_m REAL NOT NULL, min_z_m REAL NOT NULL,
    max_x_m REAL NOT NULL, max_y_m REAL NOT NULL, max_z_m REAL NOT NULL,
    geometry_segment INTEGER NOT NULL, geometry_offset INTEGER NOT NULL, geometry_bytes INTEGER NOT NULL,
    rays_segment INTEGER NOT NULL, rays_offset INTEGER NOT NULL, rays_bytes INTEGER NOT NULL,
    provenance_segment INTEGER NOT NULL, provenance_offset INTEGER NOT NULL, provenance_bytes INTEGER NOT NULL,
    bake_segment INTEGER, bake_offset INTEGER, bake_bytes INTEGER,
    visibility_segment INTEGER, visibility_offset INTEGER, visibility_bytes INTEGER,
    visible_clusters INTEGER,
    visibility_rays INTEGER,
    missing_form_factor REAL,
    escape_share REAL,
    group_id INTEGER
) STRICT;

CREATE INDEX clusters_by_group ON clusters (group_id, id);

CREATE TABLE groups (
    id INTEGER PRIMARY KEY,
    clusters INTEGER NOT NULL,
    patches INTEGER NOT NULL,
    predicted_cost REAL NOT NULL,
    working_set_bytes INTEGER NOT NULL,
    intra_group_share REAL NOT NULL
) STRICT;

CREATE TABLE branches (
    id INTEGER PRIMARY KEY,
    base_version INTEGER, -- null for branch 0
    continued_from INTEGER, -- version that somebody asked to go on from when it was the newest
    cause TEXT NOT NULL,
    options_hash TEXT, -- null until somebody solves on it
    options TEXT,
    tolerance REAL,
    opened_at REAL NOT NULL
) STRICT;

CREATE TABLE solution_versions (
    id INTEGER PRIMARY KEY,
    parent INTEGER REFERENCES solution_versions (id),
    branch INTEGER NOT NULL REFERENCES branches (id),
    iteration INTEGER NOT NULL, -- 0 emission only
    is_iteration_end INTEGER NOT NULL,
    is_kept INTEGER NOT NULL DEFAULT 1, -- 0: gc took its rows, its figures stay
    converged INTEGER NOT NULL DEFAULT 0,
    clusters_changed INTEGER NOT NULL DEFAULT 0,
    tolerance REAL,
    residual REAL,
    contraction REAL,
    predicted_error REAL,
    emitted_r_w REAL, emitted_g_w REAL, emitted_b_w REAL,
    absorbed_r_w REAL, absorbed_g_w REAL, absorbed_b_w REAL,
    escaped_r_w REAL, escaped_g_w REAL, escaped_b_w REAL,
    energy_balance REAL,
    elements INTEGER,
    links_evaluated INTEGER,
    links_stored INTEGER,
    links_reused INTEGER,
    rays INTEGER,
    unlinked_mean REAL,
    phase TEXT, -- what the next iteration does: sweep, mark, close
    threshold REAL, -- least that acts of the next iteration promise a ray, (W/m2)2 m2
    lit_mean_w_m2 REAL, -- mean irradiance of what is lit and does not emit
    estimated_nrms REAL,
    estimated_nrms_error REAL, -- its standard error
    correction REAL, -- squared error of places measured anew, relative to what rows know
    correction_error REAL,
    places REAL, -- that the correction rests on; those of iterations before count less
    gain_r REAL, -- what gathers are multiplied by so that power is kept, by channel
    gain_g REAL,
    gain_b REAL,
    made_at REAL NOT NULL
) STRICT;

CREATE INDEX versions_by_branch ON solution_versions (branch, id);

-- What `run` and `audit` found when they measured the light of a version anew; null where nothing is lit.

CREATE TABLE audits (
    version INTEGER NOT NULL REFERENCES solution_versions (id),
    places INTEGER NOT NULL, -- asked for
    seed INTEGER NOT NULL, -- of 64 bits, with a sign
    points INTEGER NOT NULL, -- measured: those under other faces are not
    audited_nrms REAL,
    audited_se REAL, -- its standard error
    audited_bias REAL, -- by paths that read no stored light
    audited_bias_se REAL,
    worst TEXT NOT NULL, -- JSON: the places whose light is farthest off, as `audit --json` prints them
    made_at REAL NOT NULL,
    PRIMARY KEY (version, places, seed)
) STRICT, WITHOUT ROWID;

CREATE TABLE cluster_materials (
    cluster INTEGER NOT NULL REFERENCES clusters (id),
    version INTEGER NOT NULL REFERENCES solution_versions (id),
    segment INTEGER NOT NULL, offset INTEGER NOT NULL, bytes INTEGER NOT NULL,
    PRIMARY KEY (cluster, version)
) STRICT, WITHOUT ROWID;

CREATE TABLE cluster_states (
    cluster INTEGER NOT NULL REFERENCES clusters (id),
    version INTEGER NOT NULL REFERENCES solution_versions (id),
    segment INTEGER NOT NULL, offset INTEGER NOT NULL, bytes INTEGER NOT NULL,
    PRIMARY KEY (cluster, version)
) STRICT, WITHOUT ROWID;

CREATE TABLE cluster_links (
    cluster INTEGER NOT NULL REFERENCES clusters (id),
    version INTEGER NOT NULL REFERENCES solution_versions (id),
    delta INTEGER NOT NULL,
    segment INTEGER NOT NULL, offset INTEGER NOT NULL, bytes INTEGER NOT NULL,
    PRIMARY KEY (cluster, version)
) STRICT, WITHOUT ROWID;

CREATE TABLE workers (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    pid INTEGER NOT NULL,
    segment INTEGER NOT NULL, -- locked for as long as the worker lives
    since REAL NOT NULL
) STRICT;

CREATE TABLE residency (
    worker INTEGER NOT NULL REFERENCES workers (id) ON DELETE CASCADE,
    cluster INTEGER NOT NULL,
    version INTEGER NOT NULL,
    PRIMARY KEY (worker, cluster)
) STRICT, WITHOUT ROWID;

CREATE INDEX residency_by_cluster ON residency (cluster, worker);

CREATE TABLE tasks (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    branch INTEGER NOT NULL REFERENCES branches (id),
    iteration INTEGER NOT NULL,
    group_id INTEGER NOT NULL,
    update_order TEXT NOT NULL CHECK (update_order IN ('jacobi', 'replace', 'sequential')),
    state TEXT NOT NULL CHECK (state IN ('free', 'running', 'done', 'merged', 'failed')),
    base_version INTEGER NOT NULL REFERENCES solution_versions (id),
    options_hash TEXT NOT NULL,
    partition_hash TEXT NOT NULL,
    attempt INTEGER NOT NULL DEFAULT 0,
    deaths INTEGER NOT NULL DEFAULT 0,
    worker INTEGER,
    worker_pid INTEGER,
    segment INTEGER, -- the lease holds while this file is locked
    claimed_at REAL,
    finished_at REAL,
    merged_version INTEGER,
    report BLOB, -- crate::model::report, bincode
    UNIQUE (branch, iteration, group_id)
) STRICT;

CREATE INDEX tasks_by_state ON tasks (state, branch, iteration);

CREATE TABLE updates (
    task INTEGER NOT NULL REFERENCES tasks (id) ON DELETE CASCADE,
    cluster INTEGER NOT NULL REFERENCES clusters (id),
    kind INTEGER NOT NULL, -- number of the extent kind: radiosity or links
    delta INTEGER NOT NULL,
    segment INTEGER NOT NULL, offset INTEGER NOT NULL, bytes INTEGER NOT NULL,
    PRIMARY KEY (task, cluster, kind)
) STRICT, WITHOUT ROWID;

CREATE TABLE processes (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    pid INTEGER NOT NULL,
    pid_started INTEGER NOT NULL, -- kernel clock ticks: tells a reused pid apart
    host TEXT NOT NULL,
    command TEXT NOT NULL,
    holds_run_lock INTEGER NOT NULL,
    reads_version INTEGER, -- kept by gc while the process lives
    since REAL NOT NULL
) STRICT;

CREATE TABLE metrics (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    stage TEXT NOT NULL,
    version INTEGER,
    name TEXT NOT NULL,
    value REAL NOT NULL,
    unit TEXT NOT NULL,
    at REAL NOT NULL
) STRICT;

-- Of every table that carries results the number of rows and the sum of their hashes: see
-- `store/seals.rs`. A row changed by anything but the program shows.

CREATE TABLE seals (
    name TEXT PRIMARY KEY,
    row_count INTEGER NOT NULL,
    row_sum INTEGER NOT NULL -- of xxh3 over each row's values, modulo 2^62
) STRICT, WITHOUT ROWID;

-- Views for people: plain words, units in the column names, local times. Read with
-- `sqlite3 STORE/scene.sqlite "select * from v_status"` (SQLite 3.40 or later), also during a run.

DROP VIEW IF EXISTS v_status;
CREATE VIEW v_status AS
WITH newest AS (SELECT * FROM solution_versions ORDER BY id DESC LIMIT 1),
     current AS (SELECT branch, max(iteration) AS iteration FROM tasks
                 WHERE branch = (SELECT max(id) FROM branches) GROUP BY branch)
SELECT (SELECT id FROM newest) AS version,
       (SELECT max(id) FROM branches) AS branch,
       coalesce((SELECT iteration FROM current), (SELECT iteration FROM newest)) AS iteration,
       (SELECT count(*) FROM tasks t JOIN current c ON t.branch = c.branch AND t.iteration = c.iteration
        WHERE t.state IN ('done', 'merged')) AS groups_done,
       (SELECT count(*) FROM groups) AS groups_total,
       (SELECT residual FROM newest) AS residual,
       (SELECT converged FROM newest) AS converged,
       (SELECT group_concat(name, ', ') FROM (SELECT name FROM stages ORDER BY finished_at)) AS stages_done,
       (SELECT clusters FROM model) AS clusters,
       (SELECT patches FROM model) AS patches,
       (SELECT area_m2 FROM model) AS area_m2;

DROP VIEW IF EXISTS v_clusters;
CREATE VIEW v_clusters AS
SELECT c.id AS cluster, o.name AS object, f.path AS file, c.patches, c.emitters, c.area_m2,
       c.group_id AS "group", c.visible_clusters, c.missing_form_factor, c.escape_share,
       c.min_x_m, c.min_y_m, c.min_z_m, c.max_x_m, c.max_y_m, c.max_z_m
FROM clusters c JOIN objects o ON o.id = c.object JOIN input_files f ON f.id = o.file;

DROP VIEW IF EXISTS v_groups;
CREATE VIEW v_groups AS
SELECT g.id AS "group", g.clusters, g.patches, g.predicted_cost,
       round(g.working_set_bytes / 1048576.0, 3) AS working_set_mib, g.intra_group_share,
       (SELECT count(*) FROM tasks t WHERE t.group_id = g.id AND t.state = 'merged') AS solved_times
FROM groups g;

DROP VIEW IF EXISTS v_tasks;
CREATE VIEW v_tasks AS
SELECT id AS task, branch, iteration, group_id AS "group", state, update_order AS "order", base_version,
       attempt, deaths, worker, worker_pid,
       strftime('%Y-%m-%dT%H:%M:%S', claimed_at, 'unixepoch', 'localtime') AS claimed,
       strftime('%Y-%m-%dT%H:%M:%S', finished_at, 'unixepoch', 'localtime') AS finished,
       round(finished_at - claimed_at, 3) AS wall_s, merged_version
FROM tasks;

DROP VIEW IF EXISTS v_processes;
CREATE VIEW v_processes AS
SELECT pid, host, command, holds_run_lock, reads_version,
       strftime('%Y-%m-%dT%H:%M:%S', since, 'unixepoch', 'localtime') AS since
FROM processes;

DROP VIEW IF EXISTS v_solution_versions;
CREATE VIEW v_solution_versions AS
-- Of versions that `gc` removed (is_kept 0) the figures stay; sample, render and export read those with is_kept 1.
SELECT id AS version, parent, branch, iteration, is_iteration_end, is_kept, tolerance, residual, contraction,
       predicted_error, converged, clusters_changed,
       emitted_r_w, emitted_g_w, emitted_b_w, absorbed_r_w, absorbed_g_w, absorbed_b_w,
       escaped_r_w, escaped_g_w, escaped_b_w, energy_balance, elements, links_evaluated, links_stored,
       links_reused, rays, unlinked_mean, estimated_nrms, estimated_nrms_error,
       strftime('%Y-%m-%dT%H:%M:%S', made_at, 'unixepoch', 'localtime') AS made
FROM solution_versions;

DROP VIEW IF EXISTS v_convergence;
CREATE VIEW v_convergence AS
SELECT branch, iteration, id AS version, phase, threshold, estimated_nrms, residual, contraction, predicted_error,
       tolerance, converged, energy_balance, elements, links_stored, links_reused, rays
FROM solution_versions WHERE is_iteration_end = 1 ORDER BY branch, iteration;

DROP VIEW IF EXISTS v_audit;
CREATE VIEW v_audit AS
SELECT a.version, v.branch, v.iteration, a.places, a.seed, a.points, a.audited_nrms, a.audited_se, a.audited_bias,
       a.audited_bias_se, v.estimated_nrms, v.tolerance, a.worst ->> '$[0].object' AS worst_object,
       a.worst ->> '$[0].point_m[0]' AS worst_x_m, a.worst ->> '$[0].point_m[1]' AS worst_y_m,
       a.worst ->> '$[0].point_m[2]' AS worst_z_m,
       strftime('%Y-%m-%dT%H:%M:%S', a.made_at, 'unixepoch', 'localtime') AS made
FROM audits a JOIN solution_versions v ON v.id = a.version;

DROP VIEW IF EXISTS v_storage;
CREATE VIEW v_storage AS
SELECT 'geometry' AS kind, count(*) AS extents, coalesce(sum(geometry_bytes), 0) / 1048576.0 AS size_mib FROM clusters
UNION ALL SELECT 'rays', count(*), coalesce(sum(rays_bytes), 0) / 1048576.0 FROM clusters
UNION ALL SELECT 'provenance', count(*), coalesce(sum(provenance_bytes), 0) / 1048576.0 FROM clusters
UNION ALL SELECT 'bake', count(bake_bytes), coalesce(sum(bake_bytes), 0) / 1048576.0 FROM clusters
UNION ALL SELECT 'visibility', count(visibility_bytes), coalesce(sum(visibility_bytes), 0) / 1048576.0 FROM clusters
UNION ALL SELECT 'materials', count(*), coalesce(sum(bytes), 0) / 1048576.0 FROM cluster_materials
UNION ALL SELECT 'radiosity', count(*), coalesce(sum(bytes), 0) / 1048576.0 FROM cluster_states
UNION ALL SELECT 'links', count(*), coalesce(sum(bytes), 0) / 1048576.0 FROM cluster_links
UNION ALL SELECT 'updates not merged', count(*), coalesce(sum(bytes), 0) / 1048576.0 FROM updates;

DROP VIEW IF EXISTS v_visibility;
CREATE VIEW v_visibility AS
SELECT count(visible_clusters) AS clusters_done, count(*) AS clusters, sum(visible_clusters) AS pairs,
       sum(visibility_rays) AS rays, avg(visible_clusters) AS visible_clusters_mean,
       max(visible_clusters) AS visible_clusters_max, avg(missing_form_factor) AS missing_form_factor_mean,
       max(missing_form_factor) AS missing_form_factor_max, avg(escape_share) AS escape_mean
FROM clusters;

DROP VIEW IF EXISTS v_metrics;
CREATE VIEW v_metrics AS
SELECT stage, version, name, value, unit, strftime('%Y-%m-%dT%H:%M:%S', at, 'unixepoch', 'localtime') AS at
FROM metrics;

"""What the paper says in numbers: T. Funkhouser, SIGGRAPH 1996. Its curves have no numbers in the text."""

INCH_M = 0.0254

# Section 6: the test floor, and what all experiments share.
FLOOR = {"patches": 6418, "clusters": 1667, "emissive_clusters": 242, "area_in2": 10_425_645}
GROUPS = 256
DELTA = 16
LINK_CACHE = "32M"

# Section 6.1.
GROUPING = {
    "iterations_ungrouped": 4,
    "iterations_grouped": 3,
    "inner": 2,
    "reused_grouped": 0.45,
    "reused_ungrouped": 0.0,
}

# Section 6.2, the fastest first; Merge and Split were about equal. Section 5.1 (Figure 7) draws 16 groups.
PARTITION = ["merge", "split", "region", "random"]
PLAN_GROUPS = 16

# Section 6.3: 1,425 is a group for each cluster that reflects.
GRANULARITY = [32, 128, 256, 1425]
BEST_GRANULARITY = 256

# Section 6.4, with eight workers: s of downloading, s of waiting for the last worker.
SCHEDULING = {"ffd": (248, 13), "ws": (98, 547), "ffd-ws": (191, 8)}
WORKERS = 8

# Section 6.5: share of linear for up to eight workers.
SPEEDUP = (0.65, 0.75)

# Section 6.6.
FIVE_FLOORS = {
    "clusters": 14_234,
    "patches": 280_836,
    "emitters": 8_542,
    "area_in2": 75_946_664,
    "elements": 7_649_958,
    "links_evaluated": 374_845_618,
    "iterations": 3,
    "hours": 168,
    "workers": 4.96,
    "speedup": 3.9,
    "master_grouping": 0.008,
    "master_download": 0.044,
    "master_upload": 0.026,
    "master_waiting": 0.890,
    "worker_download": 0.001,
    "worker_upload": 0.001,
    "worker_solving": 0.791,
    "worker_waiting": 0.050,
}

# Section 4.2: what the master holds in memory is generally less; section 6: what a worker has at least.
MASTER_MB = 20
WORKER_MB = 80

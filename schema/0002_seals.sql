-- Of every table that carries results the number of rows and the sum of their hashes: see
-- `store/seals.rs`. A row changed by anything but the program shows.

CREATE TABLE seals (
    name TEXT PRIMARY KEY,
    row_count INTEGER NOT NULL,
    row_sum INTEGER NOT NULL -- of xxh3 over each row's values, modulo 2^62
) STRICT, WITHOUT ROWID;

-- Jobs that were asked for together. `content`: what all of them ask for, hashed.

CREATE TABLE batches (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    idempotency_key TEXT UNIQUE,
    created INTEGER NOT NULL,
    client TEXT NOT NULL,
    content TEXT NOT NULL
) STRICT;

-- `item` counts from 0 within the batch, `name` is that of its file.
ALTER TABLE jobs ADD COLUMN batch INTEGER REFERENCES batches (number);
ALTER TABLE jobs ADD COLUMN item INTEGER CHECK ((item IS NULL) = (batch IS NULL));
ALTER TABLE jobs ADD COLUMN name TEXT CHECK ((name IS NULL) = (batch IS NULL));
CREATE UNIQUE INDEX jobs_batch ON jobs (batch, item) WHERE batch IS NOT NULL;

-- Renders that each client was granted, by day since 1970: quotas hold over a restart.
CREATE TABLE usage (
    client TEXT NOT NULL,
    day INTEGER NOT NULL,
    renders INTEGER NOT NULL,
    PRIMARY KEY (client, day)
) STRICT, WITHOUT ROWID;

-- Where the end of a job is told, and what has not been told yet.
ALTER TABLE jobs ADD COLUMN webhook TEXT;

CREATE TABLE deliveries (
    id TEXT PRIMARY KEY,
    url TEXT NOT NULL,
    body TEXT NOT NULL,
    attempts INTEGER NOT NULL DEFAULT 0,
    due INTEGER NOT NULL
) STRICT;
CREATE INDEX deliveries_due ON deliveries (due);

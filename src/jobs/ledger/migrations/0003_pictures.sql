-- A finished job may lose its linear picture (`picture`) and keep its file: the table is made anew, as SQLite's checks cannot be
-- changed. No number is given out twice, whatever has left: the sequence goes over, too.

CREATE TABLE jobs_anew (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    idempotency_key TEXT UNIQUE,
    created INTEGER NOT NULL,
    ended INTEGER,
    state TEXT NOT NULL CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    scene TEXT NOT NULL,
    image TEXT,
    params TEXT NOT NULL,
    priority INTEGER NOT NULL,
    client TEXT NOT NULL,
    attended INTEGER NOT NULL,
    content TEXT NOT NULL,
    last_event INTEGER NOT NULL,
    problem TEXT,
    record TEXT,
    file TEXT REFERENCES blobs (id),
    picture TEXT REFERENCES blobs (id),
    film TEXT REFERENCES blobs (id),
    batch INTEGER REFERENCES batches (number),
    item INTEGER CHECK ((item IS NULL) = (batch IS NULL)),
    name TEXT CHECK ((name IS NULL) = (batch IS NULL)),
    webhook TEXT,
    CHECK ((ended IS NOT NULL) = (state IN ('succeeded', 'failed', 'cancelled'))),
    CHECK ((problem IS NOT NULL) = (state = 'failed')),
    CHECK ((record IS NOT NULL AND file IS NOT NULL) = (state = 'succeeded')),
    CHECK (picture IS NULL OR state = 'succeeded'),
    CHECK (film IS NULL OR state IN ('queued', 'running'))
) STRICT;

INSERT INTO jobs_anew
SELECT number, id, idempotency_key, created, ended, state, scene, image, params, priority, client, attended, content, last_event,
       problem, record, file, picture, film, batch, item, name, webhook
FROM jobs;

DELETE FROM sqlite_sequence WHERE name = 'jobs_anew';
INSERT INTO sqlite_sequence (name, seq) SELECT 'jobs_anew', seq FROM sqlite_sequence WHERE name = 'jobs';
DROP TABLE jobs;
ALTER TABLE jobs_anew RENAME TO jobs;

CREATE INDEX jobs_ended ON jobs (ended);
CREATE INDEX jobs_scene ON jobs (scene) WHERE ended IS NULL;
CREATE INDEX jobs_file ON jobs (file);
CREATE INDEX jobs_picture ON jobs (picture);
CREATE INDEX jobs_film ON jobs (film);
CREATE UNIQUE INDEX jobs_batch ON jobs (batch, item) WHERE batch IS NOT NULL;

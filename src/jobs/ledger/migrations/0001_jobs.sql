-- What was uploaded, what was asked for, where it stands. Times are milliseconds since 1970.

CREATE TABLE blobs (
    id TEXT PRIMARY KEY,
    bytes INTEGER NOT NULL
) STRICT;

-- `deleted`: clients have been told that it is gone; it stays while an unfinished job needs it.
CREATE TABLE scenes (
    id TEXT PRIMARY KEY,
    upload_bytes INTEGER NOT NULL,
    used INTEGER NOT NULL,
    deleted INTEGER NOT NULL DEFAULT 0
) STRICT;

CREATE TABLE scene_files (
    scene TEXT NOT NULL REFERENCES scenes (id) ON DELETE CASCADE,
    name TEXT NOT NULL,
    blob TEXT NOT NULL REFERENCES blobs (id),
    PRIMARY KEY (scene, name)
) STRICT;
CREATE INDEX scene_files_blob ON scene_files (blob);

CREATE TABLE images (
    id TEXT PRIMARY KEY REFERENCES blobs (id),
    used INTEGER NOT NULL,
    deleted INTEGER NOT NULL DEFAULT 0
) STRICT;

-- `content`: what the picture depends on, hashed. `attended`: the job ends with the request that waits for it.
-- `last_event` is the newest id that was ever given out, whether or not that event is still there.
CREATE TABLE jobs (
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
    CHECK ((ended IS NOT NULL) = (state IN ('succeeded', 'failed', 'cancelled'))),
    CHECK ((problem IS NOT NULL) = (state = 'failed')),
    CHECK ((record IS NOT NULL AND file IS NOT NULL AND picture IS NOT NULL) = (state = 'succeeded')),
    CHECK (film IS NULL OR state IN ('queued', 'running'))
) STRICT;
CREATE INDEX jobs_ended ON jobs (ended);
CREATE INDEX jobs_scene ON jobs (scene) WHERE ended IS NULL;
CREATE INDEX jobs_file ON jobs (file);
CREATE INDEX jobs_picture ON jobs (picture);
CREATE INDEX jobs_film ON jobs (film);

CREATE TABLE events (
    job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
    id INTEGER NOT NULL,
    kind TEXT NOT NULL,
    data TEXT NOT NULL,
    PRIMARY KEY (job, id)
) STRICT, WITHOUT ROWID;

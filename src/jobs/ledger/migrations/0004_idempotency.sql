-- An idempotency key is that of one API key, whose name stands before it; clients without have theirs in common.

UPDATE jobs SET idempotency_key = client || ' ' || idempotency_key WHERE substr(client, 1, 4) = 'key:';
UPDATE batches SET idempotency_key = client || ' ' || idempotency_key WHERE substr(client, 1, 4) = 'key:';

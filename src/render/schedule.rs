//! Which samples to take next, independent of engine.

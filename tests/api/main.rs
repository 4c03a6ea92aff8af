//! The HTTP contract, tried out on a server of its own on a free port of this machine.
//!
//! Pictures are traced by a small engine of the tests, so that they are quick and same everywhere;
//! with `CANDELA_TEST_ENGINE=gpu` by the real one.

mod contract;
mod engine;
mod events;
mod faults;
mod jobs;
mod pages;
mod queue;
mod refusals;
mod render;
mod scenes;
mod shutdown;
mod support;

//! The HTTP contract, tried out on a server of its own on a free port of this machine.
//!
//! Pictures are traced by the real engine; with `CANDELA_TEST_ENGINE=test` by a small one of the tests, which needs no
//! adapter. What goes wrong on a device is always played by the latter.

mod access;
mod batches;
mod command_line;
mod connections;
mod contract;
mod denoise;
mod durable;
mod engine;
mod events;
mod faults;
mod forget;
mod hostile;
mod jobs;
mod log;
mod motion;
mod pages;
mod preview;
mod queue;
mod refusals;
mod render;
mod scenes;
mod shutdown;
mod strict;
mod support;
mod surfaces;
mod webhooks;

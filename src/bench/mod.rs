//! Benchmarks: `candela bench ...`. Each prints a table and compares side by side, interleaved, within one run: on a
//! shared machine only ratios of the same run mean anything.

pub mod trace;
mod yardstick;

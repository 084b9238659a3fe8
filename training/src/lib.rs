//! Training of fanal's reconstruction network: the network in burn, its loss, the loop, evaluation and export.

#![forbid(unsafe_code)]

pub mod ablation;
pub mod augment;
pub mod average;
pub mod backend;
pub mod batch;
pub mod cases;
pub mod checkpoint;
pub mod cli;
pub mod evaluate;
pub mod forward;
pub mod journal;
pub mod likeness;
pub mod loader;
pub mod loss;
pub mod model;
pub mod onnx;
pub mod optimise;
pub mod pareto;
pub mod plot;
pub mod report;
pub mod run;
pub mod statistics;
pub mod synthetic;
pub mod table;
pub mod train;
pub mod tuning;
pub mod view;

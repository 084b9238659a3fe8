//! Training of fanal's reconstruction network.

pub mod onnx;

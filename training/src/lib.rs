//! Training of fanal's reconstruction network.

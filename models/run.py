#!/usr/bin/env python3
"""Runs a model folder's ONNX files in onnxruntime and compares with the example that was stored beside them.

    pip install numpy onnxruntime safetensors && models/run.py models/default

What the tensors are, and how the two steps make a tree of a tree, is said in `src/network/program.rs`.
"""
import sys
from pathlib import Path

import numpy as np
import onnxruntime
from safetensors.numpy import load_file

# Single precision, summed in another order.
TOLERANCE = 1e-4


def run(folder, step, example):
    """One call of a step with the example's inputs; the largest difference of an output, relative to its largest value."""
    session = onnxruntime.InferenceSession(folder / f"{step}_step.onnx")
    inputs = {node.name: example[f"{step}.{node.name}"] for node in session.get_inputs()}
    names = [node.name for node in session.get_outputs()]
    worst = 0.0
    for name, found in zip(names, session.run(names, inputs)):
        expected = example[f"{step}.{name}"]
        if found.shape != expected.shape:
            sys.exit(f"{step}: {name} is {found.shape}, not {expected.shape}")
        difference = float(np.abs(found - expected).max() / np.abs(expected).max())
        # NaN is no larger than anything.
        if not np.isfinite(difference):
            sys.exit(f"{step}: {name} is not finite")
        worst = max(worst, difference)
    return worst


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    example = load_file(folder / "example.safetensors")
    differences = {step: run(folder, step, example) for step in ("encode", "decode")}
    print(", ".join(f"{step} step: {difference:.1e}" for step, difference in differences.items()))
    sys.exit(0 if max(differences.values()) < TOLERANCE else f"more than {TOLERANCE} from the example")

#!/usr/bin/env python3
"""Checks a model folder's ONNX files with the `onnx` package: validity, metadata, and the stored example.

    pip install onnx && tests/check-onnx.py models/NAME

The example is run by the package's reference evaluator, which shares no code with onnxruntime or with us.
"""
import json
import struct
import sys
from pathlib import Path

import numpy as np
import onnx
from onnx.reference import ReferenceEvaluator


def read_safetensors(path):
    """Tensors by name: a length, a JSON header, then the data."""
    data = path.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    kinds = {"F32": np.float32, "I64": np.int64}
    tensors = {}
    for name, entry in json.loads(data[8 : 8 + length]).items():
        start, end = (8 + length + offset for offset in entry["data_offsets"])
        tensors[name] = np.frombuffer(data[start:end], kinds[entry["dtype"]]).reshape(entry["shape"])
    return tensors


def check(folder, step, example):
    path = folder / f"{step}_step.onnx"
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    config = json.loads((folder / "config.json").read_text())
    for key in ("version", "name", "width", "features"):
        assert metadata[key] == str(config[key]), f"{path}: {key} is {metadata[key]}"
    for key in ("target", "nee"):
        assert metadata[key].lower() == str(config["mode"][key]).lower(), f"{path}: {key} is {metadata[key]}"
    inputs = {value.name: example[f"{step}.{value.name}"] for value in model.graph.input}
    names = [value.name for value in model.graph.output]
    worst = 0.0
    for name, found in zip(names, ReferenceEvaluator(model).run(names, inputs)):
        expected = example[f"{step}.{name}"]
        assert found.shape == expected.shape, f"{path}: {name} is {found.shape}, not {expected.shape}"
        difference = float(np.abs(found - expected).max() / np.abs(expected).max())
        # NaN is no larger than anything.
        assert np.isfinite(difference), f"{path}: {name} is not finite"
        worst = max(worst, difference)
    assert worst < 1e-4, f"{path}: the example differs by {worst:.1e}"
    print(f"{path}: valid, opset {model.opset_import[0].version}, example within {worst:.1e}")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    example = read_safetensors(folder / "example.safetensors")
    check(folder, "encode", example)
    check(folder, "decode", example)

"""What `Model.infer` costs beside the network: `python benches/python_infer.py [MODEL] [RUNS]`.

Each round infers one image and runs the same file in ONNX Runtime's own Python package, so that both see the
same disturbances. `around` is the time of the call, as Python sees it, less the network's own time of the
same call: checks, preprocessing, decoding, the results' memory and the interpreter.
"""

import statistics
import sys
import time

import numpy as np
import nunet_py as nunet
import onnxruntime

WARM_UP = 5


def milliseconds(call):
    """The result of `call`, and how long it took."""
    start = time.perf_counter()
    result = call()
    return result, 1e3 * (time.perf_counter() - start)


def main(name: str = "wnet_c.onnx", runs: int = 100) -> None:
    """Measure, interleaved, and print medians."""
    model = nunet.Model(name, provider="cpu")
    width, height = model.size
    rgb = np.random.default_rng(1).integers(0, 256, (height, width, 3), np.uint8)
    options = onnxruntime.SessionOptions()
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(str(model.path), options, providers=["CPUExecutionProvider"])
    outputs = [output.name for output in session.get_outputs()]

    whole, network, around, bare = [], [], [], []
    for index in range(WARM_UP + runs):
        result, took = milliseconds(lambda: model.infer(rgb))
        _, other = milliseconds(lambda: session.run(outputs, {"rgb": rgb[None]}))
        if index < WARM_UP:
            continue
        own = sum(took for stage, took in result.timings.items() if stage not in PIPELINE)
        whole.append(took)
        network.append(own)
        around.append(took - own)
        bare.append(other)
    for label, values in [
        ("infer", whole),
        ("network", network),
        ("around", around),
        ("onnxruntime.run", bare),
    ]:
        print(f"{label:16} median {statistics.median(values):8.3f} ms, lowest {min(values):8.3f} ms")
    print(f"around / network {100 * statistics.median(around) / statistics.median(network):.2f} %")


PIPELINE = {"preprocess", "decode", "cloud", "total"}

if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(*arguments[:1], *map(int, arguments[1:2]))

"""Recipe of nunet's Serial U-Nets: the zoo, its training, evaluation, quantization and export."""

import os

# ONNX Runtime's wheel reports to its vendor unless this is 1 before onnxruntime is imported. Only 0
# allows telemetry; any other value becomes 1, because ONNX Runtime treats an empty one as 0.
if os.environ.get("ORT_DISABLE_TELEMETRY") != "0":
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"

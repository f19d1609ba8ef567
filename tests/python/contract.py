"""A reader of nunet's shared memory that uses only `nunetd contract --json`.

It knows nothing of the Rust code: names, offsets, types and numbers all come from the JSON, frames through
the `iceoryx2` package of PyPI.
"""

import ctypes
import os
import time

import iceoryx2 as iox2

NUMBERS = {
    "u8": ctypes.c_uint8,
    "u32": ctypes.c_uint32,
    "u64": ctypes.c_uint64,
    "i64": ctypes.c_int64,
    "f32": ctypes.c_float,
    "f64": ctypes.c_double,
}


def new_node():
    """A node where nunet's are: in `NUNET_IPC_ROOT`, whose FNV-1a hash is in the names in `/dev/shm`."""
    iox2.set_log_level(iox2.LogLevel.Fatal)
    config = iox2.config.default()
    if root := os.environ.get("NUNET_IPC_ROOT"):
        number = 0x811C9DC5
        for byte in os.fsencode(root):
            number = (number ^ byte) * 0x01000193 % 2**32
        config.global_cfg.root_path = iox2.Path.new(root)
        config.global_cfg.prefix = iox2.FileName.new(f"iox2_{number:08x}_")
    return iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)


def structure(layout):
    """A ctypes structure with the fields, offsets and type name that the contract gives."""
    fields = []
    for field in layout["fields"]:
        number = NUMBERS[field["type"]]
        fields.append((field["name"], number * field["count"] if field["count"] > 1 else number))
    name = layout["type"]
    made = type(
        name.split(".")[-1],
        (ctypes.Structure,),
        {
            "_fields_": fields,
            "type_name": staticmethod(lambda: name),
        },
    )
    for field in layout["fields"]:
        assert getattr(made, field["name"]).offset == field["offset"], field
    assert ctypes.sizeof(made) == layout["bytes"]
    return made


def block(layout):
    """The payload's element: an array of bytes."""
    name = layout["type"]
    return type(
        "Block",
        (ctypes.Structure,),
        {
            "_fields_": [("data", ctypes.c_uint8 * layout["bytes"])],
            "type_name": staticmethod(lambda: name),
        },
    )


class Reader:
    """Reads one topic of a camera."""

    def __init__(self, contract, camera, topic, timeout=10.0):
        self.contract = contract
        self.header_type = structure(contract["header"])
        self.block_type = block(contract["block"])
        self.node = new_node()
        name = f"nunet/{camera}/{topic}"
        assert name.replace(f"/{camera}/", "/CAMERA/") in contract["services"]
        self.service = retry(lambda: self._open(name), timeout)
        self.subscriber = self.service.subscriber_builder().create()

    def _open(self, name):
        return (
            self.node.service_builder(iox2.ServiceName.new(name))
            .publish_subscribe(iox2.Slice[self.block_type])
            .user_header(self.header_type)
            .open()
        )

    def next(self, timeout=10.0):
        """The next message: a copy of its header, and of its payload's bytes."""
        sample = retry(self._receive, timeout)
        header = self.header_type.from_buffer_copy(sample.user_header().contents)
        payload = ctypes.string_at(sample.payload().as_ptr(), header.payload_bytes)
        sample.delete()
        return header, payload

    def _receive(self):
        sample = self.subscriber.receive()
        if sample is None:
            raise TimeoutError("no frame")
        return sample

    def word(self, enumeration, number):
        """The name of a number in the header."""
        words = {value: word for word, value in self.contract["enums"][enumeration].items()}
        return words[number]


def retry(attempt, timeout):
    """Retries until it succeeds or the time is over; then the last error is raised."""
    deadline = time.monotonic() + timeout
    while True:
        try:
            return attempt()
        except Exception:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.01)

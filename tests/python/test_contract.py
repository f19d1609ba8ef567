"""An independent client reads frames through the contract's JSON alone."""

import iceoryx2 as iox2
import numpy as np
from contract import Reader

KEY = iox2.AttributeKey.new("nunet.contract")


def depth_of(reader, header, payload):
    assert reader.word("encoding", header.encoding) == "depth_f32"
    assert header.row_stride_bytes == header.width * 4
    return np.frombuffer(payload, np.float32).reshape(header.height, header.width)


def test_header_fields_fill_the_header_without_gaps(contract):
    end = 0
    sizes = {"u8": 1, "u32": 4, "u64": 8, "i64": 8, "f32": 4, "f64": 8}
    for field in contract["header"]["fields"]:
        assert field["offset"] == end, field
        end += sizes[field["type"]] * field["count"]
    assert end == contract["header"]["bytes"] == 1024


def test_the_service_says_its_contract_before_it_is_read(contract, camera):
    reader = Reader(contract, camera, "depth")
    values = [value.to_string() for value in reader.service.attributes.key_values(KEY)]
    assert values == [str(contract["contract"])]


def test_depth_frames_arrive_with_rising_sequence_and_a_header_that_fits(contract, camera):
    reader = Reader(contract, camera, "depth")
    last = None
    for _ in range(5):
        header, payload = reader.next()
        depth = depth_of(reader, header, payload)
        assert header.contract_version == contract["contract"]
        assert reader.word("topic", header.topic) == "depth"
        assert reader.word("units", header.units) in ("metre", "relative")
        assert header.payload_bytes == depth.nbytes
        assert header.invalid_pixels == np.isnan(depth).sum()
        assert bytes(header.reserved) == bytes(len(header.reserved))
        assert last is None or header.sequence > last
        last = header.sequence


def test_payload_is_aligned_to_a_block(contract, camera):
    reader = Reader(contract, camera, "depth")
    sample = None
    while sample is None:
        sample = reader.subscriber.receive()
    assert sample.payload().as_ptr() % contract["block"]["bytes"] == 0
    sample.delete()

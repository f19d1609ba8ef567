"""C and C++ programs, compiled as a user would, with a running nunetd."""

import ctypes
import itertools
import os
import pathlib
import signal
import subprocess

import iceoryx2 as iox2
import pytest
from conftest import MODEL, running, unavailable
from contract import Reader, new_node

ROOT = pathlib.Path(__file__).parents[2]
INCLUDE = ROOT / "crates" / "nunet-c" / "include"
PROGRAMS = ROOT / "tests" / "c"
COUNTER = itertools.count()
# The system libraries that Rust's standard library needs:
# `cargo rustc -p nunet-c -- --print native-static-libs`.
SYSTEM = ["-lpthread", "-ldl", "-lm", "-lrt", "-lutil"]
C = [os.environ.get("CC", "cc"), "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
CXX = [os.environ.get("CXX", "c++"), "-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic"]
SANITIZE = ["-g", "-fsanitize=address,undefined", "-fno-omit-frame-pointer"]


@pytest.fixture(scope="session")
def library(nunetd):
    """The folder with libnunet.a and libnunet.so: `NUNET_LIBRARY`, else beside the daemon.

    `cargo test` leaves them in `deps`, `cargo build -p nunet-c` beside the daemon; the newer ones count.
    """
    beside = pathlib.Path(nunetd).resolve().parent
    named = os.environ.get("NUNET_LIBRARY")
    folders = [pathlib.Path(named)] if named else [beside, beside / "deps"]
    there = [
        folder for folder in folders if all((folder / f"libnunet.{kind}").exists() for kind in ("a", "so"))
    ]
    assert there, (
        f"no libnunet.a and libnunet.so in {folders}: run `cargo build -p nunet-c`, or set NUNET_LIBRARY"
    )
    return max(there, key=lambda folder: (folder / "libnunet.so").stat().st_mtime)


@pytest.fixture(scope="session", params=["static", "shared"])
def build(library, tmp_path_factory, request):
    """Compiles a source with all warnings as errors, and links it with one of the two libraries."""
    static = [str(library / "libnunet.a"), *SYSTEM]
    shared = [f"-L{library}", "-lnunet", f"-Wl,-rpath,{library}"]
    folder = tmp_path_factory.mktemp(request.param)

    def compiled(source, *more):
        program = folder / source.name.replace(".", "-")
        compiler = CXX if source.suffix == ".cpp" else C
        link = static if request.param == "static" else shared
        command = [*compiler, f"-I{INCLUDE}", *more, str(source), "-o", str(program), "-pthread", *link]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        assert done.returncode == 0 and not done.stderr, done.stderr
        return str(program)

    return compiled


def run(*command, **more):
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=180, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def unused_name():
    return f"pytest-c-{os.getpid()}-{next(COUNTER)}"


def fnv(data):
    total = 14695981039346656037
    for byte in data:
        total = (total ^ byte) * 1099511628211 & 0xFFFFFFFFFFFFFFFF
    return f"{total:016x}"


@pytest.fixture
def still(nunetd):
    """The name of a camera that shows one image, whose center has depth in each frame."""
    name, image = unused_name(), ROOT / "models" / "clip" / "rgb" / "bedroom_00.jpg"
    source = ["--source", str(image), "--loop", "--rate", "30"]
    with running([nunetd, "--model", str(MODEL), "--camera", name, *source]):
        yield name


def test_the_examples_read_depth(build, still):
    for source in ["c/subscribe.c", "cpp/subscribe.cpp"]:
        lines = run(build(ROOT / "examples" / source), still, "5").splitlines()
        numbers = [int(line.split()[1].rstrip(":")) for line in lines]
        assert len(lines) == 5 and numbers == sorted(set(numbers)), lines
        for line in lines:
            words = line.replace(",", "").split()
            assert float(words[words.index("captured") + 1]) > 0, line
            assert float(words[words.index("center") + 1]) > 0, line


def test_the_examples_fit_on_a_screen():
    for source in ["c/subscribe.c", "c/publish.c", "cpp/subscribe.cpp"]:
        assert len((ROOT / "examples" / source).read_text().splitlines()) < 60, source


def first_block(document, language):
    """The first code block of a document in a language."""
    _, _, rest = (ROOT / document).read_text().partition(f"```{language}\n")
    lines, fence, _ = rest.partition("```\n")
    assert fence, f"{document} has no block in {language}"
    return lines


def test_the_code_in_the_documents_compiles(build, tmp_path):
    c, cpp = tmp_path / "document.c", tmp_path / "document.cpp"
    c.write_text(first_block("docs/book/shared-memory.md", "c"))
    cpp.write_text(first_block("README.md", "cpp"))
    for source in (c, cpp):
        assert "nunet" in source.read_text()
        build(source)


def test_c_sees_what_another_reader_sees(build, contract, camera):
    program = build(PROGRAMS / "dump.c")
    topics = {"depth": 1, "labels": 2, "cloud": 3}
    readers = {topic: Reader(contract, camera, topic) for topic in topics}
    seen = {}
    with subprocess.Popen(
        [program, camera, "60"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as dump:
        for _ in range(40):
            for topic, number in topics.items():
                header, payload = readers[topic].next()
                seen[header.sequence, number] = (bytes(header), payload)
        stdout, stderr = dump.communicate(timeout=180)
    assert dump.returncode == 0, stderr
    lines = stdout.splitlines()
    dumped = {(int(sequence), int(topic)): hashes for sequence, topic, *hashes in map(str.split, lines[:-1])}
    assert len(dumped) == 180
    # A few frames are enough, because hashing a cloud in Python is slow.
    for number in topics.values():
        shared = [key for key in sorted(dumped.keys() & seen.keys()) if key[1] == number][:2]
        assert shared, (sorted(dumped), sorted(seen))
        for key in shared:
            header, payload = seen[key]
            assert dumped[key] == [fnv(header), fnv(payload)], key
    word, model, provider, _first_stage, adds_up = lines[-1].split()
    assert (word, model, provider, adds_up) == ("stats", MODEL.name, "cpu", "1")


def test_offsets_and_numbers_are_those_of_the_contract(build, contract, tmp_path):
    expected = {}
    sizes = {"u8": 1, "u32": 4, "u64": 8, "i64": 8, "f64": 8}
    for field in contract["header"]["fields"]:
        expected[f"offsetof(nunet_header_t, {field['name']})"] = field["offset"]
        expected[f"sizeof(((nunet_header_t *)0)->{field['name']})"] = sizes[field["type"]] * field["count"]
    for enumeration, words in contract["enums"].items():
        name = enumeration.removeprefix("capture_")
        constants = {f"NUNET_{name}_{word}".upper(): number for word, number in words.items()}
        expected.update(constants if enumeration != "wake" else {})
    prints = "\n".join(f'  printf("%lu\\n", (unsigned long){what});' for what in expected)
    source = tmp_path / "offsets.c"
    source.write_text(
        f'#include <stdio.h>\n#include "nunet.h"\nint main(void) {{\n{prints}\n  return 0;\n}}\n'
    )
    found = [int(line) for line in run(build(source)).splitlines()]
    assert dict(zip(expected, found, strict=True)) == expected
    assert len(found) > 80


def test_misuse_is_an_error_and_no_crash(build, camera):
    assert run(build(PROGRAMS / "misuse.c"), camera, unused_name()) == "0 failures\n"


def test_misuse_touches_no_wrong_memory(build, camera, tmp_path):
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    command = [C[0], *SANITIZE, str(probe), "-o", str(tmp_path / "probe")]
    links = subprocess.run(command, check=False, capture_output=True, text=True)
    if links.returncode != 0:
        unavailable(f"the compiler has no sanitizers: {links.stderr.strip()[-200:]}")
    program = build(PROGRAMS / "misuse.c", *SANITIZE)
    assert run(program, camera, unused_name()) == "0 failures\n"


def test_objects_of_cpp_own_move_and_throw(build, camera):
    assert run(build(PROGRAMS / "classes.cpp"), camera, unused_name()) == "0 failures\n"


def test_a_reader_and_its_frame_survive_the_daemon(build, nunetd):
    name = unused_name()
    command = [nunetd, "-q", "--model", str(MODEL), "--source", "demo", "--camera", name, "--rate", "30"]
    program = build(PROGRAMS / "survive.c")
    with (
        subprocess.Popen(command, stderr=subprocess.DEVNULL) as daemon,
        subprocess.Popen([program, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as client,
    ):
        assert client.stdout.readline() == f"{daemon.pid}\n"
        assert client.stdout.readline() == "reading\n"
        daemon.send_signal(signal.SIGKILL)
        daemon.wait(timeout=30)
        print("go", file=client.stdin, flush=True)
        assert client.stdout.readline() == "alone\n"
        with running(command):
            stdout = client.communicate("go\n", timeout=120)[0]
    assert stdout == "done\n" and client.returncode == 0


def test_another_contract_is_refused_by_name(build):
    name = unused_name()
    node = new_node()
    attributes = iox2.AttributeSpecifier.new().define(
        iox2.AttributeKey.new("nunet.contract"), iox2.AttributeValue.new("2")
    )
    service = (
        node.service_builder(iox2.ServiceName.new(f"nunet/{name}/depth"))
        .publish_subscribe(iox2.Slice[ctypes.c_uint8])
        .create_with_attributes(attributes)
    )
    command = [build(ROOT / "examples" / "c" / "subscribe.c"), name, "1"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "speaks version `2`" in done.stderr and "\nhint: " in done.stderr, (
        done.stderr
    )
    del service


def test_a_camera_in_c_feeds_a_daemon(build, nunetd):
    name = unused_name()
    with running([build(ROOT / "examples" / "c" / "publish.c"), name, "100000"]):
        command = [nunetd, "-q", "--model", str(MODEL), "--source", f"shm:{name}", "--camera", name]
        with running(command):
            lines = run(build(ROOT / "examples" / "c" / "subscribe.c"), name, "5").splitlines()
            assert len(lines) == 5


@pytest.mark.parametrize(("encoding", "size"), [("yuyv", (33, 25)), ("nv12", (33, 25)), ("mono8", (35, 25))])
def test_a_daemon_takes_every_encoding_as_c_lays_it(build, nunetd, contract, encoding, size):
    name = unused_name()
    number = contract["enums"]["encoding"][encoding]
    camera = [build(PROGRAMS / "camera.c"), name, str(number), *map(str, size), "100000"]
    command = [nunetd, "--model", str(MODEL), "--source", f"shm:{name}", "--camera", name, "--frames", "3"]
    with running(camera):
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def installed(library, tmp_path_factory):
    """The prefix into which `install.sh` installed."""
    prefix = tmp_path_factory.mktemp("prefix")
    run(ROOT / "crates" / "nunet-c" / "install.sh", library, prefix)
    return prefix


def test_the_shared_library_has_a_versioned_soname(installed):
    stdout = run("readelf", "-d", installed / "lib" / "libnunet.so")
    assert "Library soname: [libnunet.so.0]" in stdout
    assert (installed / "lib" / "libnunet.so.0").resolve().name == "libnunet.so.0.1.0"


def test_pkg_config_leads_to_the_libraries(installed, camera, tmp_path):
    environment = os.environ | {"PKG_CONFIG_PATH": str(installed / "lib" / "pkgconfig")}
    flags = run("pkg-config", "--cflags", "--libs", "nunet", env=environment).split()
    static = run("pkg-config", "--variable=libdir", "nunet", env=environment).strip() + "/libnunet.a"
    source = str(ROOT / "examples" / "c" / "subscribe.c")
    run(C[0], source, "-o", tmp_path / "shared", *flags)
    # What `ldconfig` does for a folder of the system.
    environment["LD_LIBRARY_PATH"] = str(installed / "lib")
    assert len(run(tmp_path / "shared", camera, "2", env=environment).splitlines()) == 2
    run(C[0], source, "-o", tmp_path / "static", flags[0], static, *SYSTEM)
    assert len(run(tmp_path / "static", camera, "2").splitlines()) == 2


def test_cmake_finds_the_package(installed, camera, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(reader LANGUAGES C CXX)\n"
        "find_package(nunet 0.1 REQUIRED)\n"
        f"add_executable(shared {ROOT}/examples/cpp/subscribe.cpp)\n"
        f"add_executable(static {ROOT}/examples/c/subscribe.c)\n"
        "set_target_properties(shared PROPERTIES CXX_STANDARD 17)\n"
        "target_link_libraries(shared PRIVATE nunet::nunet)\n"
        "target_link_libraries(static PRIVATE nunet::static)\n"
    )
    run("cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={installed}")
    run("cmake", "--build", tmp_path / "build")
    for program in ("shared", "static"):
        assert len(run(tmp_path / "build" / program, camera, "2").splitlines()) == 2


def test_cmake_refuses_a_package_of_another_version(installed, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(reader LANGUAGES C)\n"
        "find_package(nunet 0.2 REQUIRED)\n"
    )
    command = ["cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={installed}"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode != 0 and "0.1.0" in done.stderr, done.stderr

"""Runs programs in their own network namespace and reports every packet that they send.

    unshare --net --mount python network_witness.py SECONDS JSON-LIST-OF-COMMANDS

In the new network namespace, a local route makes every address this machine. A name server
answers each question with 127.0.0.1 and a listener on port 443 accepts connections, so that a program gets as
far as it would with a real network. A raw socket sees all packets, also those to hosts given by number.

Before the programs start, the witness looks up a name and connects to it: a witness that does not see its own
packets fails. Prints JSON: `control` (what it saw of its own packets), `seen` (what it saw while the programs
ran) and `codes` (how the programs ended after SIGTERM).
"""

import json
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

IPV4, TCP, UDP = 0x0800, 6, 17
# Longer than any command may take to end after SIGTERM.
END_TIMEOUT = 30
FILES = {"/etc/resolv.conf": "nameserver 127.0.0.1\n", "/etc/nsswitch.conf": "hosts: files dns\n"}


def run(*command):
    """Runs a command that must succeed."""
    subprocess.run(command, check=True)


def prepare():
    """Makes all addresses local, and lets only the name server resolve names."""
    run("ip", "link", "set", "lo", "up")
    run("ip", "route", "add", "local", "default", "dev", "lo")
    for name, text in FILES.items():
        target = pathlib.Path(name).resolve()
        # If a file is missing, glibc's default is the same as our text.
        if target.exists():
            with tempfile.NamedTemporaryFile("w", delete=False) as file:
                file.write(text)
            pathlib.Path(file.name).chmod(0o644)
            run("mount", "--bind", file.name, str(target))
            pathlib.Path(file.name).unlink()


def answer_names():
    """Answers every question with 127.0.0.1."""
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    server.bind(("0.0.0.0", 53))

    def serve():
        while True:
            question, sender = server.recvfrom(512)
            header = question[:2] + struct.pack("!HHHHH", 0x8180, 1, 1, 0, 0)
            body = question[12 : question.index(b"\0", 12) + 5]
            record = b"\xc0\x0c" + struct.pack("!HHIH", 1, 1, 60, 4) + socket.inet_aton("127.0.0.1")
            server.sendto(header + body + record, sender)

    threading.Thread(target=serve, daemon=True).start()


def accept_connections():
    """Accepts every connection to port 443."""
    server = socket.create_server(("0.0.0.0", 443))

    def serve():
        kept = []
        while True:
            kept.append(server.accept())

    threading.Thread(target=serve, daemon=True).start()


def describe(packet):
    """Protocol and destination of a packet; of packets other than IPv4, the protocol only."""
    (kind,) = struct.unpack_from("!H", packet, 12)
    if kind != IPV4:
        return f"ethertype {kind:#06x}"
    protocol, host = packet[23], socket.inet_ntoa(packet[30:34])
    if protocol not in (TCP, UDP):
        return f"IP protocol {protocol} to {host}"
    start = 14 + 4 * (packet[14] & 15)
    _, port = struct.unpack_from("!HH", packet, start)
    question = b""
    if protocol == UDP and port == 53:
        question = b" for " + packet[start + 20 : packet.index(b"\0", start + 20)]
    return f"{'tcp' if protocol == TCP else 'udp'} to {host}:{port}" + question.decode("ascii", "replace")


def watch():
    """Returns a list to which every packet is appended."""
    seen = []
    ear = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))

    def listen():
        while True:
            seen.append(describe(ear.recv(65536)))

    threading.Thread(target=listen, daemon=True).start()
    return seen


def control(seen):
    """Sends packets, and returns those that were seen."""
    host = socket.gethostbyname("control.example")
    with socket.create_connection((host, 443), timeout=10), socket.socket(socket.AF_INET) as direct:
        # A host that is given by its number.
        direct.settimeout(10)
        direct.connect(("192.0.2.7", 443))
    time.sleep(0.5)
    return sorted(set(seen))


def main():
    """Runs the commands and prints what was seen."""
    seconds, commands = float(sys.argv[1]), json.loads(sys.argv[2])
    prepare()
    answer_names()
    accept_connections()
    seen = watch()
    own = control(seen)
    seen.clear()
    processes = [
        subprocess.Popen(command, stdout=sys.stderr, stdin=subprocess.DEVNULL) for command in commands
    ]
    time.sleep(seconds)
    early = [process.poll() for process in processes]
    for process in processes:
        process.send_signal(signal.SIGTERM)
    codes = [process.wait(END_TIMEOUT) for process in processes]
    print(json.dumps({"control": own, "seen": sorted(set(seen)), "early": early, "codes": codes}))
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()

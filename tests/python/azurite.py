"""Microsoft's emulator of Azure's blob storage (Azurite) on loopback, with an empty container `lab`.

Usage: azurite.py PROGRAM, which is `azurite-blob` of npm's package `azurite`. Prints the port; ends with its
standard input.
"""

import base64
import hashlib
import hmac
import http.client
import socket
import subprocess
import sys
import tempfile
import time
from email.utils import formatdate

# The emulator's only account, and its key: https://learn.microsoft.com/azure/storage/common/storage-connect-azurite
ACCOUNT = "devstoreaccount1"
KEY = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="
CONTAINER = "lab"
VERSION = "2021-08-06"
STARTS_WITHIN_S = 60


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def make_container(port: int) -> int:
    """Asks for it with a shared key; returns HTTP's status."""
    date = formatdate(usegmt=True)
    headers = f"x-ms-date:{date}\nx-ms-version:{VERSION}\n"
    resource = f"/{ACCOUNT}/{ACCOUNT}/{CONTAINER}\nrestype:container"
    signed = "PUT" + "\n" * 12 + headers + resource
    digest = hmac.digest(base64.b64decode(KEY), signed.encode(), hashlib.sha256)
    connection = http.client.HTTPConnection("127.0.0.1", port)
    connection.request(
        "PUT",
        f"/{ACCOUNT}/{CONTAINER}?restype=container",
        headers={
            "x-ms-date": date,
            "x-ms-version": VERSION,
            "Content-Length": "0",
            "Authorization": f"SharedKey {ACCOUNT}:{base64.b64encode(digest).decode()}",
        },
    )
    return connection.getresponse().status


def main(program: str) -> None:
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        words = [program, "--silent", "--disableTelemetry", "--location", folder, "--blobPort", str(port)]
        with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as server:
            try:
                begin = time.monotonic()
                while True:
                    try:
                        status = make_container(port)
                        break
                    except ConnectionError:
                        if server.poll() is not None or time.monotonic() - begin > STARTS_WITHIN_S:
                            sys.exit("the emulator does not start")
                        time.sleep(0.1)
                if status != 201:
                    sys.exit(f"the container is not made: HTTP {status}")
                print(port, flush=True)
                sys.stdin.read()
            finally:
                server.terminate()


if __name__ == "__main__":
    main(*sys.argv[1:])

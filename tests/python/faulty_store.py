"""An S3 server on loopback (moto's) behind a proxy that breaks a share of the requests.

Serves until its standard input ends. Prints the proxy's port, then answers commands, one a line:

    share X          breaks a share X of the requests from now on
    expire N TOKEN   after N more requests, answers those with this session token that it has expired
    sums             JSON: the SHA-256 of each object by its key
    grep TEXT        JSON: the keys of objects that hold the text, in their content or their metadata
    stats            JSON: how many requests came, began an upload in parts, and were broken in each way
"""

import hashlib
import http.client
import json
import random
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from moto.moto_server.threaded_moto_server import ThreadedMotoServer
from moto.s3.models import s3_backends

BUCKET = "bucket"
SEED = 7
# Longer than the clients' timeout.
DELAY_S = 4.0
EXPIRED = b"<Error><Code>ExpiredToken</Code><Message>The provided token has expired.</Message></Error>"
WAYS = ["500", "503", "cut before", "cut after", "torn", "late"]


class Faults:
    """Which requests are broken, and how."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.random = random.Random(SEED)
        self.share = 0.0
        self.expires_after = -1
        self.expired_token = ""
        self.n_requests = 0
        self.n_in_parts = 0
        self.broken: Counter[str] = Counter()

    def next(self, token: str | None, *, begins_parts: bool) -> str | None:
        with self.lock:
            self.n_requests += 1
            self.n_in_parts += begins_parts
            if self.expires_after > 0:
                self.expires_after -= 1
            elif self.expires_after == 0 and token == self.expired_token:
                self.broken["expired"] += 1
                return "expired"
            if self.random.random() >= self.share:
                return None
            way = WAYS[sum(self.broken.values()) % len(WAYS)]
            self.broken[way] += 1
            return way


FAULTS = Faults()


class Proxy(BaseHTTPRequestHandler):
    """Hands requests on to moto, or breaks them."""

    protocol_version = "HTTP/1.1"
    moto_port = 0

    def log_message(self, *_args: object) -> None:
        pass

    def answer(self, status: int, body: bytes, headers: Sequence[tuple[str, str]] = ()) -> None:
        self.send_response(status)
        sized = [name.lower() for name, _ in headers]
        for name, value in headers:
            if name.lower() not in ("transfer-encoding", "connection", "date", "server"):
                self.send_header(name, value)
        if "content-length" not in sized:
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def cut(self) -> None:
        self.close_connection = True

    def handle_one(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        begins_parts = self.command == "POST" and "?uploads" in self.path
        way = FAULTS.next(self.headers.get("x-amz-security-token"), begins_parts=begins_parts)
        if way == "cut before":
            return self.cut()
        if way in ("500", "503"):
            return self.answer(int(way), b"<Error><Code>SlowDown</Code></Error>")
        if way == "expired":
            return self.answer(400, EXPIRED)
        # A put that is done after its client gave up could bring back what was deleted meanwhile: no client
        # can help that, so a put is done at once and answered late.
        is_put = self.command == "PUT"
        if way == "late" and not is_put:
            time.sleep(DELAY_S)
        moto = http.client.HTTPConnection("127.0.0.1", self.moto_port)
        moto.request(self.command, self.path, body, dict(self.headers))
        answer = moto.getresponse()
        content = answer.read()
        headers = answer.getheaders()
        if way == "late" and is_put:
            time.sleep(DELAY_S)
        if way == "cut after":
            return self.cut()
        if way == "torn" and self.command == "GET" and len(content) > 1:
            self.send_response(answer.status)
            for name, value in headers:
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(content[: len(content) // 2])
            return self.cut()
        if way == "torn":
            return self.cut()
        self.answer(answer.status, content, headers)

    do_GET = do_PUT = do_POST = do_DELETE = do_HEAD = handle_one  # noqa: N815


class Server(ThreadingHTTPServer):
    """A thread a connection."""

    daemon_threads = True

    def handle_error(self, *_args: object) -> None:
        """A client that gave up is what is tested."""


def objects() -> dict[str, object]:
    for backends in s3_backends.values():
        for backend in backends.values():
            if BUCKET in backend.buckets:
                return dict(backend.buckets[BUCKET].keys.items())
    return {}


def obey(line: str) -> object:
    command, *words = line.split()
    if command == "share":
        FAULTS.share = float(words[0])
        return None
    if command == "expire":
        FAULTS.expired_token = words[1]
        FAULTS.expires_after = int(words[0])
        return None
    if command == "sums":
        return {name: hashlib.sha256(key.value).hexdigest() for name, key in objects().items()}
    if command == "grep":
        text = words[0].encode()
        held = {name: key.value + str(dict(key.metadata)).encode() for name, key in objects().items()}
        return [name for name, content in held.items() if text in content]
    if command == "stats":
        counts = {"requests": FAULTS.n_requests, "in parts": FAULTS.n_in_parts}
        return counts | {"broken": dict(FAULTS.broken)}
    raise SystemExit(f"no such command: {line}")


def main() -> None:
    moto = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    moto.start()
    _, Proxy.moto_port = moto.get_host_and_port()
    connection = http.client.HTTPConnection("127.0.0.1", Proxy.moto_port)
    signed = "AWS4-HMAC-SHA256 Credential=maker/1/us-east-1/s3/aws4_request"
    connection.request("PUT", f"/{BUCKET}", headers={"Authorization": signed})
    assert connection.getresponse().status == 200
    proxy = Server(("127.0.0.1", 0), Proxy)
    threading.Thread(target=proxy.serve_forever, daemon=True).start()
    print(proxy.server_address[1], flush=True)
    for line in sys.stdin:
        print(json.dumps(obey(line)), flush=True)


if __name__ == "__main__":
    main()

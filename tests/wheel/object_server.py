"""Objects in memory behind the part of S3 that the tests need, on loopback: no conditions, parts or pages."""

import hashlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, unquote, urlsplit
from xml.sax.saxutils import escape


class ObjectServer(ThreadingHTTPServer):
    """Serves as a context; `objects` holds content and SHA-256 by `bucket/key`."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), _Request)
        self.objects = {}

    def __enter__(self):
        threading.Thread(target=self.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_):
        self.shutdown()
        self.server_close()

    def environment(self):
        """What the program finds it by."""
        return {
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.server_port}",
            "AWS_ALLOW_HTTP": "true",
            "AWS_REGION": "us-east-1",
            "AWS_ACCESS_KEY_ID": "testing",
            "AWS_SECRET_ACCESS_KEY": "testing",
            "NO_PROXY": "127.0.0.1",
        }


class _Request(BaseHTTPRequestHandler):
    # Connections stay open, as a real server's do.
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def answer(self, status, body=b"", headers=(), *, with_body=True):
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)

    def key(self):
        return unquote(urlsplit(self.path).path).strip("/")

    def do_GET(self):
        asked = parse_qs(urlsplit(self.path).query)
        if "list-type" in asked:
            self.list(asked.get("prefix", [""])[0])
            return
        found = self.server.objects.get(self.key())
        if found is None:
            self.answer(404, b"<Error><Code>NoSuchKey</Code></Error>", with_body=self.command == "GET")
            return
        body, sha256 = found
        headers = [("ETag", etag(body)), ("Last-Modified", "Thu, 01 Jan 2026 00:00:00 GMT")]
        headers += [("x-amz-meta-sha256", sha256)] if sha256 else []
        self.answer(200, body, headers, with_body=self.command == "GET")

    def do_HEAD(self):
        self.do_GET()

    def do_PUT(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.objects[self.key()] = (body, self.headers.get("x-amz-meta-sha256"))
        self.answer(200, headers=[("ETag", etag(body))])

    def do_DELETE(self):
        self.server.objects.pop(self.key(), None)
        self.answer(204)

    def list(self, prefix):
        bucket = self.key()
        contents = "".join(
            f"<Contents><Key>{escape(name.removeprefix(bucket + '/'))}</Key><ETag>{escape(etag(body))}</ETag>"
            f"<Size>{len(body)}</Size><LastModified>2026-01-01T00:00:00.000Z</LastModified></Contents>"
            for name, (body, _) in sorted(self.server.objects.items())
            if name.startswith(f"{bucket}/{prefix}")
        )
        told = f"<ListBucketResult><IsTruncated>false</IsTruncated>{contents}</ListBucketResult>"
        self.answer(200, told.encode())


def etag(body):
    return f'"{hashlib.md5(body).hexdigest()}"'

"""Publishes until it is killed; run as a process by the tests."""

import sys

from streamkit import Pipeline

key, endpoint = sys.argv[1:]
Pipeline.parse(f"videotestsrc ! zenohsink key={key} connect={endpoint} wait-subscribers=1").run(timeout_s=60)

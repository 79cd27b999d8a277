"""Publishes without end, until it is killed; a process of its own in the tests."""

import sys

from streamkit import Pipeline

key, endpoint = sys.argv[1:]
Pipeline.parse(f"videotestsrc ! zenohsink key={key} connect={endpoint} wait-subscribers=1").run(timeout_s=60)

"""The command `streamkit report`: one page about a finished run, which needs no network."""

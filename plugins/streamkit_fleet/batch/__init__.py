"""`streamkit batch`: an archive of files through one pipeline, in parallel, with resumption."""

"""`streamkit doctor`: looks at a stream or file, gives verdicts, and a pipeline to begin with."""

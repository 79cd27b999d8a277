"""`streamkit doctor`: checks a stream or file and suggests a pipeline."""

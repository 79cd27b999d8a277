"""Elements for telemetry: posesync, telemetryparse and vmtiencode."""

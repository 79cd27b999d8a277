"""What a service needs around a pipeline: health, systemd notifications, metrics, supervision."""

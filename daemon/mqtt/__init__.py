"""What a run publishes by MQTT: made in the run, kept and sent by a process of its own."""

"""The parts of `abbe.compcore.files.model_file`: its sections, its records, its comments."""

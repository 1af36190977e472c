"""The virtual CMM: what a part program would find on a machine whose errors are known so well."""

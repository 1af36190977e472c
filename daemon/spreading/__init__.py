"""One way of spreading work: over processes of this computer, or a Dask scheduler's workers."""

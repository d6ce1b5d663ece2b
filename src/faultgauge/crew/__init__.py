"""Who does much work: this process, or the workers of a scheduler of Dask."""

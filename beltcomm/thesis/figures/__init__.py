"""The figures of the design source's comparisons."""

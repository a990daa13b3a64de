"""`pmsm-bench commission`: a motor that nobody knows, to parameters in its drive."""

"""One estimator: records as segments, noise and torque path, likelihood, minimum, intervals, the stored fit of a run."""

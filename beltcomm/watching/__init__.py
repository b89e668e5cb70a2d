"""A model that runs along in production: moves found in a stream, each judged by the run's fit, what drifts against limits."""

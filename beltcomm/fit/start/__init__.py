"""Start values of a fit: first estimate of a short record, its torque path, rigid axis, undersampled rows."""

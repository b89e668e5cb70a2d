"""Pictures: values to figures.  Absolute scales, so that two runs compare; colours that everybody can tell apart."""

"""Residuals of a model, cut so that a page can show them along every coordinate, and candidates for any part of them."""

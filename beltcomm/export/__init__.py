"""The designed cascade as text for other machines: coefficients and equations in YAML, C99, IEC 61131-3 structured text."""

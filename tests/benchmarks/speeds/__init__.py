"""What ``speed.py`` measures: one module per topic, and how times and figures are judged and kept."""

"""The version, where modules of every layer may read it: the package itself knows ``run``, which knows them all."""

__version__ = "0.2.0"

"""Imports every module of the installed package but those that are programs, and says how many."""

import importlib
import pkgutil
import sys

import truepose

names = [module.name for module in pkgutil.walk_packages(truepose.__path__, "truepose.")]
modules = [importlib.import_module(name) for name in names if not name.endswith(".__main__")]
if "site-packages" not in str(truepose.__file__) or len(modules) < 100:
    sys.exit(f"{truepose.__file__}: found {len(modules)} modules, expected those of the installed wheel")
sys.stdout.write(f"{len(modules)} modules of {truepose.__file__}\n")

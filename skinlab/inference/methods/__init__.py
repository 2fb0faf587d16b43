"""The inverse methods, one a file, found by looking: every module here that defines METHOD."""

from skinlab.inference.methods.base import Method, Option, check_method
from skinlab.plugins import Registry

METHODS: Registry[Method] = Registry("method", __name__, "METHOD", "skinlab.methods", check_method)

get_method, method_names = METHODS.get, METHODS.names

__all__ = ["METHODS", "Method", "Option", "get_method", "method_names"]

"""Examples of correct calls, shown in error messages."""

from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import TypeVar

_Target = TypeVar("_Target")


def usage(example: str) -> Callable[[_Target], _Target]:
    """Decorate a function or class with an example of a correct call.

    The example is added to the message of a TypeError about the arguments.

    Examples
    --------
    >>> @usage("area(radius=2)")
    ... def area(*, radius):
    ...     return 3.14 * radius**2
    >>> area(2)
    Traceback (most recent call last):
    TypeError: area() takes 0 positional arguments but 1 was given; write area(radius=2)
    """

    def decorate(target):
        if isinstance(target, type):
            target.__init__ = decorate(target.__init__)
            return target

        @wraps(target)
        def call(*args, **kwargs):
            try:
                return target(*args, **kwargs)
            except TypeError as error:
                try:
                    signature(target).bind(*args, **kwargs)
                except TypeError:
                    raise TypeError(f"{error}; write {example}") from None
                raise

        return call

    return decorate

"""Pictures of results: what they share is in ``drawing``, the rest is by kind of result.

Every result draws its pictures by ``plot``; behind each is a ``plot_x(result, *, ax=None)`` here, which draws into the
axes it is given, or into axes of a new figure, and returns the axes. Nothing is shown, saved, or changed globally in
matplotlib, which is imported when the first picture is drawn. Pictures of data other than results are public.
"""

from lazy_loader import attach_stub

__all__ = ["plot_object", "plot_scene"]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)

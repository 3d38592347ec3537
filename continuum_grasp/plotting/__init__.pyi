from .drawing.axes import inline_svg as inline_svg
from .grasp.picture import plot_grasp as plot_grasp
from .grasp.view import plot_object as plot_object
from .scene import plot_scene as plot_scene

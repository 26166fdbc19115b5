"""Objects to grasp: a procedural catalogue, and folders of one's own meshes."""

from pecgrasp_env.objects.catalogue import CLASSES, LARS_CLASSES, Catalogue, make_object
from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.model import ObjectModel, Part

__all__ = ["CLASSES", "LARS_CLASSES", "Catalogue", "ObjectError", "ObjectModel", "Part", "make_object"]

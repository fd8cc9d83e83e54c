"""Where to begin: variants of the tasks that are easier to learn, and recipes that learn them in minutes."""

from thruster_agents.recipes.variants import VARIANTS, Variant, make, make_vec, variant_of

__all__ = ["VARIANTS", "Variant", "make", "make_vec", "variant_of"]

"""Pure JAX geometry: vectors and poses, convex shapes, signed distances."""

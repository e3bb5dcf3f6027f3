"""The papers' results regenerated, published figures beside ours."""

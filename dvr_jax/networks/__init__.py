"""The shipped networks: KIND.npz, with KIND.json (what it was trained on) and KIND.png (its curves)."""

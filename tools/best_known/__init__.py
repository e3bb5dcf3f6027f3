"""Best known motions: solved for by transcription, and kept only as the environment itself scores them."""

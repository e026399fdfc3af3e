"""Feature tracks by prediction: each corner goes to the track that predicts it."""

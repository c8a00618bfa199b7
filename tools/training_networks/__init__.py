"""Builder of the networks `train_*`, on which scenarios for training drive (`tools.build_training_networks`)."""

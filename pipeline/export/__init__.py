"""Datasets in the formats of others: LeRobot, Hugging Face parquet, WebDataset shards, glTF scenes."""

"""Export datasets to other formats: LeRobot, Hugging Face parquet, WebDataset shards, glTF scenes."""

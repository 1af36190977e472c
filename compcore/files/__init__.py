"""Files: everything that the mathematics reads or writes goes through here.

Public: `model_file.load_model`, `model_file.save_model`, `campaign_file.read_campaigns`.
"""

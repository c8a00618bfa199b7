"""What an agent works out from detections and received messages: fused object lists, tracks of static objects."""

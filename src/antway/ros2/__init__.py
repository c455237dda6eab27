"""antway as a ROS 2 node; only this package imports rclpy."""

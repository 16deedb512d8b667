"""A node of rospy, run by the Python that ROS belongs to: hears odometry and drives, and prints what it heard.

Drives in a curve until it has heard the robot drive `far` [m]; then stops it by the service.
"""

import itertools
import sys

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger


def main(far: float) -> None:
    rospy.init_node("driver")
    place: list[float] = [0.0]
    numbers: list[int] = []

    def hear(message: Odometry) -> None:
        place[0] = message.pose.pose.position.x
        numbers.append(message.header.seq)

    rospy.Subscriber("/odom", Odometry, hear)
    command = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
    twist = Twist()
    twist.linear.x, twist.angular.z = 0.3, 0.05
    rate = rospy.Rate(20)
    while place[0] < far and not rospy.is_shutdown():
        if len(numbers) >= 20:
            command.publish(twist)
        rate.sleep()
    steps = [after - before for before, after in itertools.pairwise(numbers)]
    print("gaps", sum(step - 1 for step in steps if step > 0), "begun again", sum(step < 0 for step in steps))
    stop = rospy.ServiceProxy("/stop", Trigger)
    print("stop", stop().success)
    sys.stdout.flush()


main(float(sys.argv[1]))

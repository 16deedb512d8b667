"""A program of its own with roslibpy: hears odometry at one port while it drives at another.

Prints a line for whatever it has done. Goes on driving until a line of input comes; then it stops the robot.
"""

import sys
import threading

import roslibpy

COMMAND = {"linear": {"x": 0.3, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.1}}


def main(tells: int, takes: int) -> None:
    seen, drives = roslibpy.Ros("127.0.0.1", tells), roslibpy.Ros("127.0.0.1", takes)
    seen.run(timeout=10)
    drives.connect()
    first = threading.Event()

    print("topics", *sorted(seen.get_topics()), flush=True)
    odometry = roslibpy.Topic(seen, "/odom", "nav_msgs/Odometry", throttle_rate=50, queue_length=1)
    odometry.subscribe(lambda message: first.set())
    first.wait(10)
    print("heard", flush=True)
    commands = roslibpy.Topic(drives, "/cmd_vel", "geometry_msgs/Twist")
    commands.advertise()
    over = threading.Event()

    def wait() -> None:
        sys.stdin.readline()
        over.set()

    threading.Thread(target=wait, daemon=True).start()
    while not over.wait(0.05):
        commands.publish(roslibpy.Message(COMMAND))
    for name in ("stop", "done"):
        answer = roslibpy.Service(drives, f"/{name}", "std_srvs/Trigger").call(roslibpy.ServiceRequest())
        print("answer", answer["success"], answer["message"], flush=True)
    print("over", flush=True)
    drives.close()
    seen.terminate()


main(*map(int, sys.argv[1:]))

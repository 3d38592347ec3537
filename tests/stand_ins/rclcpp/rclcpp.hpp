// What the node uses of rclcpp, to compile it where there is no ROS 2.
#pragma once
#include <chrono>
#include <functional>
#include <memory>
#include <string>

namespace rclcpp {
struct Logger {};
struct TimerBase {
  using SharedPtr = std::shared_ptr<TimerBase>;
  void cancel();
};
template <class Message>
struct Publisher {
  using SharedPtr = std::shared_ptr<Publisher>;
  void publish(const Message &message);
};
template <class Message>
struct Subscription {
  using SharedPtr = std::shared_ptr<Subscription>;
};
class Node {
 public:
  explicit Node(const std::string &name);
  Logger get_logger();
  double declare_parameter(const std::string &name, double value);
  template <class Value>
  bool get_parameter(const std::string &name, Value &value);
  template <class Message>
  std::shared_ptr<Publisher<Message>> create_publisher(const std::string &topic, int depth);
  template <class Message>
  std::shared_ptr<Subscription<Message>> create_subscription(const std::string &topic, int depth,
                                                             std::function<void(const Message &)> taken);
  std::shared_ptr<TimerBase> create_wall_timer(std::chrono::duration<double> period, std::function<void()> work);
};
void init(int count, char **words);
void spin(std::shared_ptr<Node> node);
void shutdown();
}  // namespace rclcpp

void rclcpp_log(rclcpp::Logger logger, const char *format, ...);
#define RCLCPP_ERROR(...) rclcpp_log(__VA_ARGS__)
#define RCLCPP_WARN(...) rclcpp_log(__VA_ARGS__)

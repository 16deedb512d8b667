// A program on eProsima's Fast DDS, with the names that rmw_fastrtps gives topics and types. `scripts/ros2_peers` builds it.
//
//   peer DOMAIN GID_LENGTH
//
// Takes lines: `hear TOPIC TYPE reliable|best_effort volatile|latched`, `say TOPIC TYPE reliable|best_effort NUMBER...`
// (20 times a second, and always the newest), `keep` likewise (once, latched), `quiet TOPIC`, `end`. Prints what it finds, hears and refuses, a line each.
#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

#include <chrono>
#include <cstring>
#include <iostream>
#include <map>
#include <mutex>
#include <sstream>
#include <thread>
#include <vector>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::rtps::GUID_t;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::ParticipantDiscoveryInfo;
using eprosima::fastrtps::rtps::ReaderDiscoveryInfo;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using eprosima::fastrtps::rtps::WriterDiscoveryInfo;
typedef std::vector<uint8_t> Bytes;

std::mutex printing;
void print(const std::string& line) {
    std::lock_guard<std::mutex> lock(printing);
    std::cout << line << std::endl;
}

struct BytesType : TopicDataType {
    explicit BytesType(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 4 << 20;
        m_isGetKeyDefined = false;
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        Bytes& bytes = *static_cast<Bytes*>(data);
        memcpy(payload->data, bytes.data(), bytes.size());
        payload->length = bytes.size();
        payload->encapsulation = CDR_LE;
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

std::string dds_type(const std::string& ros) {  // nav_msgs/msg/Odometry
    size_t one = ros.find('/'), other = ros.rfind('/');
    return ros.substr(0, one) + "::" + ros.substr(one + 1, other - one - 1) + "::dds_::" + ros.substr(other + 1) + "_";
}

size_t gid_length;
std::string hex(const uint8_t* bytes, size_t count) {
    std::ostringstream out;
    for (size_t i = 0; i < count; i++) out << "0123456789abcdef"[bytes[i] >> 4] << "0123456789abcdef"[bytes[i] & 15];
    return out.str();
}
std::string hex(const GUID_t& guid) { return hex(guid.guidPrefix.value, 12) + hex(guid.entityId.value, 4); }

template <typename T>
T get(Cdr& cdr) {
    T value;
    cdr >> value;
    return value;
}
std::string header(Cdr& cdr) {
    get<int32_t>(cdr), get<uint32_t>(cdr);
    return get<std::string>(cdr);
}
void doubles(Cdr& cdr, double* values, int count) {
    for (int i = 0; i < count; i++) values[i] = get<double>(cdr);
}

std::string told(const std::string& type, Bytes& bytes) {
    FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    cdr.read_encapsulation();
    std::ostringstream out;
    double d[64];
    if (type == "nav_msgs/msg/Odometry") {
        out << header(cdr);
        out << " " << get<std::string>(cdr);
        doubles(cdr, d, 7 + 36);
        out << " x " << d[0];
        doubles(cdr, d, 6 + 36);
        out << " speed " << d[0] << " rate " << d[5];
    } else if (type == "tf2_msgs/msg/TFMessage") {
        for (uint32_t count = get<uint32_t>(cdr); count; count--) {
            out << header(cdr);
            out << ">" << get<std::string>(cdr) << " ";
            doubles(cdr, d, 7);
        }
    } else if (type == "sensor_msgs/msg/LaserScan") {
        out << header(cdr);
        for (int i = 0; i < 7; i++) get<float>(cdr);
        out << " " << get<std::vector<float>>(cdr).size() << " beams";
    } else if (type == "nav_msgs/msg/OccupancyGrid") {
        out << header(cdr);
        get<int32_t>(cdr), get<uint32_t>(cdr);
        float resolution = get<float>(cdr);
        uint32_t width = get<uint32_t>(cdr), height = get<uint32_t>(cdr);
        doubles(cdr, d, 7);
        uint32_t cells = get<uint32_t>(cdr), occupied = 0;
        for (uint32_t i = 0; i < cells; i++) occupied += get<int8_t>(cdr) == 100;
        out << " " << width << "x" << height << " of " << resolution << " from " << d[0] << " " << d[1] << " cells " << cells
            << " occupied " << occupied;
    } else if (type == "diagnostic_msgs/msg/DiagnosticArray") {
        header(cdr);
        for (uint32_t count = get<uint32_t>(cdr); count; count--) {
            out << static_cast<int>(get<uint8_t>(cdr)) << " " << get<std::string>(cdr) << "; ";
            get<std::string>(cdr), get<std::string>(cdr);
            for (uint32_t values = get<uint32_t>(cdr); values; values--) get<std::string>(cdr), get<std::string>(cdr);
        }
    } else if (type == "rmw_dds_common/msg/ParticipantEntitiesInfo") {
        auto gids = [&](uint32_t count) {
            for (; count; count--) {
                Bytes gid(gid_length);
                for (auto& byte : gid) byte = get<uint8_t>(cdr);
                out << " " << hex(gid.data(), gid_length);
            }
        };
        gids(1);
        for (uint32_t nodes = get<uint32_t>(cdr); nodes; nodes--) {
            std::string space = get<std::string>(cdr), name = get<std::string>(cdr);
            out << " node " << space << " " << name << " readers";
            gids(get<uint32_t>(cdr));
            out << " writers";
            gids(get<uint32_t>(cdr));
        }
    } else {
        out << bytes.size() << " bytes";
    }
    return out.str();
}

Bytes made(const std::string& type, const std::vector<double>& numbers) {
    FastBuffer buffer;
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    bool on_map = type.find("Pose") != std::string::npos;
    if (type.find("Stamped") != std::string::npos)
        cdr << int32_t(0) << uint32_t(0) << std::string(on_map ? "map" : "base_link");
    for (double number : numbers) {
        if (type.find("std_msgs") == 0) cdr << uint8_t(number);  // Bool, Empty
        else if (type.find("ackermann") == 0) cdr << float(number);
        else cdr << number;
    }
    return Bytes(buffer.getBuffer(), buffer.getBuffer() + cdr.getSerializedDataLength());
}

struct Finder : DomainParticipantListener {
    void on_participant_discovery(DomainParticipant*, ParticipantDiscoveryInfo&& found) override {
        auto& data = found.info.m_userData;
        bool here = found.status == ParticipantDiscoveryInfo::DISCOVERED_PARTICIPANT;
        bool removed = found.status == ParticipantDiscoveryInfo::REMOVED_PARTICIPANT;
        bool dropped = found.status == ParticipantDiscoveryInfo::DROPPED_PARTICIPANT;
        if (here || removed || dropped)
            print((here ? "participant " : removed ? "left " : "lost ") + hex(found.info.m_guid) + " " +
                  std::string(data.begin(), data.end()));
    }
    void on_subscriber_discovery(DomainParticipant*, ReaderDiscoveryInfo&& found) override {
        if (found.status == ReaderDiscoveryInfo::DISCOVERED_READER) endpoint("reader", found.info);
    }
    void on_publisher_discovery(DomainParticipant*, WriterDiscoveryInfo&& found) override {
        if (found.status == WriterDiscoveryInfo::DISCOVERED_WRITER) endpoint("writer", found.info);
    }
    template <typename Info>
    void endpoint(const char* kind, Info& info) {
        auto& data = info.m_qos.m_userData;
        bool reliable = info.m_qos.m_reliability.kind == RELIABLE_RELIABILITY_QOS;
        bool latched = info.m_qos.m_durability.kind == TRANSIENT_LOCAL_DURABILITY_QOS;
        print(std::string(kind) + " " + hex(info.guid()) + " " + info.topicName().to_string() + " " + info.typeName().to_string() +
              (reliable ? " reliable" : " best_effort") + (latched ? " latched " : " volatile ") +
              std::string(data.begin(), data.end()));
    }
};

struct Hearing : DataReaderListener {
    std::string topic, type;
    void on_data_available(DataReader* reader) override {
        Bytes bytes;
        SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
            if (info.valid_data) print("heard " + topic + " " + told(type, bytes));
    }
    void on_requested_incompatible_qos(DataReader*, const RequestedIncompatibleQosStatus& status) override {
        print("refused " + topic + " policy " + std::to_string(status.last_policy_id));
    }
};
struct Saying : DataWriterListener {
    std::string topic;
    void on_offered_incompatible_qos(DataWriter*, const OfferedIncompatibleQosStatus& status) override {
        print("refused " + topic + " policy " + std::to_string(status.last_policy_id));
    }
};

int main(int, char** arguments) {
    gid_length = atoi(arguments[2]);
    Finder finder;
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(
        atoi(arguments[1]), PARTICIPANT_QOS_DEFAULT, &finder, StatusMask::none());
    auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    std::map<std::string, Topic*> topics;
    auto topic_of = [&](const std::string& name, const std::string& type) {
        if (!topics.count(name)) {
            TypeSupport support(new BytesType(dds_type(type)));
            participant->register_type(support);
            topics[name] = participant->create_topic(name, support.get_type_name(), TOPIC_QOS_DEFAULT);
        }
        return topics[name];
    };
    std::map<std::string, std::pair<DataWriter*, Bytes>> said;
    std::mutex saying;
    bool ended = false;
    std::thread writer([&] {
        while (!ended) {
            {
                std::lock_guard<std::mutex> lock(saying);
                for (auto& each : said) each.second.first->write(&each.second.second);
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(50));
        }
    });
    std::map<std::string, DataWriter*> writers;
    for (std::string line; std::getline(std::cin, line) && line != "end";) {
        std::istringstream words(line);
        std::string order, topic, type, reliability, durability;
        words >> order >> topic;
        if (order == "quiet") {
            std::lock_guard<std::mutex> lock(saying);
            said.erase(topic);
            continue;
        }
        words >> type >> reliability;
        auto reliable = reliability == "reliable" ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
        if (order == "hear") {
            words >> durability;
            auto* hearing = new Hearing;
            hearing->topic = topic, hearing->type = type;
            DataReaderQos quality = DATAREADER_QOS_DEFAULT;
            quality.reliability().kind = reliable;
            quality.durability().kind = durability == "latched" ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
            quality.history().depth = 10;
            subscriber->create_datareader(topic_of(topic, type), quality, hearing);
        } else {
            std::vector<double> numbers;
            for (double number; words >> number;) numbers.push_back(number);
            if (!writers.count(topic)) {
                auto* listener = new Saying;
                listener->topic = topic;
                DataWriterQos quality = DATAWRITER_QOS_DEFAULT;
                quality.reliability().kind = reliable;
                quality.durability().kind = order == "keep" ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
                quality.history().depth = 10;
                writers[topic] = publisher->create_datawriter(topic_of(topic, type), quality, listener);
            }
            std::lock_guard<std::mutex> lock(saying);
            Bytes message = made(type, numbers);
            if (order == "keep") writers[topic]->write(&message);
            else said[topic] = {writers[topic], message};
        }
    }
    ended = true;
    writer.join();
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
    return 0;
}
